"""Training networks of any kind: what policies and predictors have in common; needs PyTorch."""
