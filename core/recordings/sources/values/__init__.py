"""What values of event files mean, and which of them can be true: sizes, times, polarities, strays."""
