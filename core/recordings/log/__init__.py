"""The log in which a recording grows until it is closed, and how it becomes HDF5 then or after a kill."""
