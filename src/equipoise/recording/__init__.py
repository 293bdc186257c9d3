"""What was felt and sent while a robot moved: records, their files, and the log of a run."""
