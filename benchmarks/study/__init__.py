"""The metric study: which measure of a BEV foretells how well a policy drives on it?"""
