"""Work on many machines: a pool over Dask, the workers that serve it, and batch systems that start them."""
