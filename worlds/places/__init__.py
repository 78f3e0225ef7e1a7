"""Places of a user: height maps, meshes and MJCF become worlds like those of the catalogue.

Read `place.py` first."""
