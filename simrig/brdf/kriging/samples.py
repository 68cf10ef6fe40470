"""What was measured of a BRDF: pairs of directions with values, each pair once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from simrig.directions.spherical import to_vector

_LEAST_DARK = 2  # pairs beyond the end of a material's data that are measured black
_DARK = 1e-6  # over the median
_MOST_DARK_WITHIN = 0.1  # of the pairs before the end


@dataclass(frozen=True, eq=False)
class Samples:
    """What was measured of a BRDF.

    Attributes:
        wi, wv: (n, 3) unit vectors.
        values: (n, 3) f_r in 1/sr, >= 0.
        theta_i_max, theta_v_max: how far the rig may look, radians.
        again: (n,) whether a pair was measured more than once.
        dark_beyond: whether what was measured beyond these angles is black, and left out.
    """

    wi: np.ndarray
    wv: np.ndarray
    values: np.ndarray
    theta_i_max: float
    theta_v_max: float
    again: np.ndarray
    dark_beyond: bool = False

    @classmethod
    def of(
        cls,
        wi: np.ndarray,
        wv: np.ndarray,
        values: np.ndarray,
        theta_i_max: float,
        theta_v_max: float,
        again: np.ndarray | None = None,
    ) -> Samples:
        """Return samples in the order of measurement; of a pair measured again the last counts.

        A plan measures a pair again that contradicts all others about it (see
        ``simrig.brdf.kriging.outliers``).
        """
        again = np.zeros(len(values), dtype=bool) if again is None else again
        _, first, own = np.unique(
            np.hstack([wi, wv]), axis=0, return_index=True, return_inverse=True
        )
        own = own.reshape(-1)
        last = np.zeros(len(first), dtype=np.int64)
        np.maximum.at(last, own, np.arange(len(values)))
        counts = np.bincount(own, again, len(first)) + np.bincount(own)
        order = np.argsort(first)
        first, last, more = first[order], last[order], counts[order] > 1
        return cls(wi[first], wv[first], values[last], theta_i_max, theta_v_max, more)

    @classmethod
    def recorded(cls, angles: np.ndarray, values: np.ndarray) -> Samples:
        """Return the samples of a measurement, up to the end of the material's data (``lit``).

        Args:
            angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.
            values: (n, 3) f_r in 1/sr.
        """
        theta_i, theta_v, phi_i, phi_v = angles.T
        sides = to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)
        return cls.of(*sides, values, float(theta_i.max()), float(theta_v.max())).lit()

    def __len__(self) -> int:
        return len(self.values)

    def with_more(self, wi: np.ndarray, wv: np.ndarray, values: np.ndarray) -> Samples:
        """Return these samples and more."""
        return Samples.of(
            np.concatenate([self.wi, wi]),
            np.concatenate([self.wv, wv]),
            np.concatenate([self.values, values]),
            self.theta_i_max,
            self.theta_v_max,
            np.concatenate([self.again, np.zeros(len(values), dtype=bool)]),
        )

    def only(self, kept: np.ndarray) -> Samples:
        """Return some of them, by a mask (n,)."""
        arrays = ("wi", "wv", "values", "again")
        return replace(self, **{name: getattr(self, name)[kept] for name in arrays})

    def lit(self) -> Samples:
        """Return the samples up to the end of the material's data, if nothing but 0 lies beyond.

        Data files are often 0 from some polar angle on, of light or of view. That step is no
        structure of the material, and kriging across it would smear it.
        """
        thetas = np.arccos(np.clip(np.minimum(self.wi[:, 2], self.wv[:, 2]), -1.0, 1.0))
        means = self.values.mean(axis=1)
        lit = means > _DARK * np.median(means)
        last = float(thetas[lit].max(initial=0.0))
        beyond = thetas > last
        few_within = np.count_nonzero(~lit & ~beyond) < _MOST_DARK_WITHIN * np.count_nonzero(lit)
        if np.count_nonzero(beyond) < _LEAST_DARK or not few_within:
            return self
        end = 0.5 * (last + float(thetas[beyond].min()))
        reach = min(self.theta_i_max, end), min(self.theta_v_max, end)
        return replace(
            self.only(~beyond), theta_i_max=reach[0], theta_v_max=reach[1], dark_beyond=True
        )
