"""Four rendered cameras: rig, appearance, motion, renderer."""
