"""What a run has done so far, step by step, and who is told."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import WindowFacts
from bwbn_bayes.results import StageFacts

Listener = Callable[[str, StageFacts | None], None]
"""Called with what is being done and, after each step of it, that step's facts."""


@dataclass
class History:
    """Collects the steps of a run and tells the listener."""

    listener: Listener | None
    began: float
    stages: list[StageFacts]

    def say(self, text: str, facts: StageFacts | None = None) -> None:
        """Announce, and keep the facts if there are any."""
        if facts is not None:
            facts = replace(facts, stage=len(self.stages), elapsed_s=time.perf_counter() - self.began)
            self.stages.append(facts)
        if self.listener is not None:
            self.listener(text, facts)

    def tell_window(self, posterior: Posterior, facts: WindowFacts) -> None:
        """Least squares reached the end of a window."""
        record = posterior.record
        if record.has_time:
            reached, window = f"{facts.end:.0f} s of {record.duration:.0f} s", f"0 to {facts.end:.1f} s"
        else:
            n_points = int(np.searchsorted(record.times, facts.end + 0.5 * record.time_step))
            reached, window = f"{n_points} of {record.n_times} points", f"the first {n_points} points"
        self.say(
            f"fitted the first {reached}",
            StageFacts(
                stage=0,
                tempering_parameter=facts.end / record.duration,
                acceptance=float("nan"),
                effective_sample_size=float("nan"),
                n_solves=facts.n_solves,
                log_evidence=float("nan"),
                elapsed_s=0.0,
                label=f"least squares on {window}, {facts.n_candidates} candidates",
            ),
        )

    def tell_draws(self, posterior: Posterior, effective: int, reached: float, n_draws: int) -> None:
        """Importance sampling has so many draws, worth so many independent ones."""
        self.say(
            f"{reached:.0f} of {effective} effective draws",
            StageFacts(
                stage=0,
                tempering_parameter=1.0,
                acceptance=float("nan"),
                effective_sample_size=reached,
                n_solves=posterior.solves.total,
                log_evidence=float("nan"),
                elapsed_s=0.0,
                label=f"importance sampling, {n_draws} draws",
            ),
        )

    def tell_stage(self, label: str, facts: StageFacts) -> None:
        """TMCMC finished a stage."""
        self.say(f"TMCMC, {label}", replace(facts, label=f"TMCMC, {label}"))
