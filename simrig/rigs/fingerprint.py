"""A short hash by which a resumed measurement knows its material again."""

from __future__ import annotations

import hashlib

import numpy as np

from simrig.brdf.protocol import Brdf


def fingerprint(brdf: Brdf) -> str:
    """Return a short hash of a BRDF's kind and data."""
    digest = hashlib.sha256(type(brdf).__name__.encode())
    for key, value in sorted(brdf.data().items()):
        digest.update(key.encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()[:16]
