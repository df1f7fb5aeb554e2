"""What a first start has to compile and to make, beside the app: child processes, steps in words, their card."""
