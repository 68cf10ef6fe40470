"""What runs studies: cells, stores, pages, Dask."""
