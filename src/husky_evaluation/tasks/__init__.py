"""Many tasks at once: by the processes of this machine, or by a Dask cluster."""
