"""What was measured of a BRDF: pairs of directions with values, each pair once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Samples:
    """What was measured of a BRDF.

    Attributes:
        wi, wv: (n, 3) unit vectors.
        values: (n, 3) f_r in 1/sr, >= 0.
        theta_i_max, theta_v_max: how far the rig may look, radians.
        again: (n,) whether a pair was measured more than once.
    """

    wi: np.ndarray
    wv: np.ndarray
    values: np.ndarray
    theta_i_max: float
    theta_v_max: float
    again: np.ndarray

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

        Args:
            wi, wv, values, theta_i_max, theta_v_max, again: see the class.
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
        wi, wv, values = (part[kept] for part in (self.wi, self.wv, self.values))
        return Samples(wi, wv, values, self.theta_i_max, self.theta_v_max, self.again[kept])
