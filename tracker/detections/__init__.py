"""What boxes and images of a camera say about where people stand: ground points, occlusion, cross-view groups, silhouettes, appearance.

Read `ground_points.py` first."""
