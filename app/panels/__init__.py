"""One file per panel: each builds its controls once, sends commands, and shows the state it is given."""
