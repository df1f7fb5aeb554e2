"""From the events of all cameras to a prediction: align, triangulate, gate the track, predict."""
