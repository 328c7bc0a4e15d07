"""What a run leaves behind: the run folder, the journal, the time series, every message, and the score."""
