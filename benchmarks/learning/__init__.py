"""The report on learning: which trainings it is made of, its tables, charts and verdicts."""
