"""Watch: a rally, live or recorded, in 3D, in pictures and in figures."""
