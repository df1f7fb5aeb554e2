"""Two people's labels of one recording held beside each other, and settled where they differ."""
