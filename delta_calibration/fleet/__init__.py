"""Many machines at once: sessions worked through on a cluster, and what their fleet tells.

`places.py`, `work.py` and `run.py` need Dask and fsspec, the store SQLAlchemy
(`pip install 'delta_calibration[fleet]'`).
"""
