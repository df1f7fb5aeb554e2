"""The 3D scene of a recording as pictures, films and pages."""
