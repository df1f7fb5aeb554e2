"""Train: start a training, watch its balls, curves and landings."""
