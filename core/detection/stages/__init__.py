"""One file for each stage of the readable pipeline: a pure function and its frozen config."""
