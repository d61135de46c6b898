"""The level kmeans, with which the search of fit and full begins (``search``)."""
