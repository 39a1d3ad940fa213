"""Camera-to-BEV predictors; they arrive with the cameras."""
