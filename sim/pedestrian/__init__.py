"""One person: proportions, gait, feet on uneven ground, gaze, and the meshes of body and clothes.

Read `skeleton.py` first."""
