"""BEV sources: what stands between the world and the driver."""
