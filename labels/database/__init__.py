"""Labels in SQLite: a file for each recording, in which rows are only ever added. `labels.store` is how it is used."""
