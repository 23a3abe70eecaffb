"""Names of causes by an amortised posterior, for comparison (extra `rivals`).

A masked autoregressive flow learns from simulated sessions how the strengths of all causes follow
from what each cause alone explains (neural posterior estimation: Papamakarios and Murray 2016,
NeurIPS 29; the sbi package). A cause is named if its posterior probability of being present is at
least one half; that probability is its confidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SAMPLES = 1000
_PRESENT = float(np.log1p(5.0))  # ln (1 + lambda) above which a cause counts as present
_LOW, _HIGH = -10.0, 30.0  # of the box that holds all strengths
_NAMED = 0.5


@dataclass(frozen=True)
class Amortised:
    """A trained posterior of the strengths of some causes, given some features."""

    posterior: Any
    causes: tuple[str, ...]
    features: tuple[str, ...]

    def named(self, features: Mapping[str, float]) -> list[dict[str, Any]]:
        """Causes that are more probably present than not, most probable first."""
        import torch

        seen = torch.as_tensor(_row(features, self.features), dtype=torch.float32)
        drawn = self.posterior.sample((_SAMPLES,), x=seen, show_progress_bars=False).numpy()
        present = np.mean(drawn > _PRESENT, axis=0).tolist()
        said = [
            {"cause": cause, "confidence": p}
            for cause, p in zip(self.causes, present, strict=True)
            if p >= _NAMED
        ]
        return sorted(said, key=lambda one: -one["confidence"])


def trained(sessions: Sequence[Mapping[str, Any]], seed: int) -> Amortised:
    """Train the posterior.

    Args:
        sessions: each with `hidden`, lambda by cause, and `features`, what each cause explains.
        seed: of the training.
    """
    import torch
    from sbi.inference import NPE
    from sbi.utils import BoxUniform

    causes = tuple(sorted({cause for one in sessions for cause in one["hidden"]}))
    features = tuple(sorted({name for one in sessions for name in one["features"]}))
    rng = np.random.default_rng(seed)
    torch.manual_seed(seed)
    strengths = np.array([_row(one["hidden"], causes) for one in sessions])
    # causes that are absent have a spread, as a flow cannot represent a point
    strengths = np.where(strengths > 0, strengths, -rng.random(strengths.shape))
    seen = np.array([_row(one["features"], features) for one in sessions])
    ends = (torch.full((len(causes),), end) for end in (_LOW, _HIGH))
    inference = NPE(prior=BoxUniform(*ends), show_progress_bars=False)
    inference.append_simulations(
        *(torch.as_tensor(a, dtype=torch.float32) for a in (strengths, seen))
    )
    inference.train(show_train_summary=False)
    return Amortised(inference.build_posterior(), causes, features)


def _row(values: Mapping[str, float], names: Sequence[str]) -> Array:
    """ln (1 + value) of each name, 0 where there is none, (k,)."""
    return np.log1p([max(values.get(name, 0.0), 0.0) for name in names])
