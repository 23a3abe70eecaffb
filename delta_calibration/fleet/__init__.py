"""Many machines at once: their sessions are processed on a cluster and evaluated together.

`places.py`, `work.py` and `run.py` need Dask and fsspec, the store SQLAlchemy
(`pip install 'delta_calibration[fleet]'`).
"""
