"""What a run or a plan is shown as afterwards: report.json and the figure."""
