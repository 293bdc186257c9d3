"""The live view and the replay: what is drawn, from recordings alone, in a browser page or a Rerun file."""
