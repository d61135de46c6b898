"""The levels of the estimator: kmeans, fit, full."""
