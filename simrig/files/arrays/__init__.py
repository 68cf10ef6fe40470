"""Tables of reflectance as plain arrays: NumPy's ``.npz`` and ``.npy``, MATLAB's ``.mat``."""
