"""What a run or a plan is shown as afterwards: report.json, report.html and the figures."""
