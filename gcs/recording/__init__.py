"""What a run leaves behind: the run folder, the journal, and the score."""
