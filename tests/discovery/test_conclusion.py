"""What is said of each name in the end, on explanations without any dynamics."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import t as student

from bwbn_bayes.discovery import conclusion
from bwbn_bayes.discovery.cross_validation import N_BLOCKS, CrossValidation
from bwbn_bayes.discovery.probability import Beliefs

MECHANISMS = {"a": "wear", "b": "play", "c": "wear"}
PER_BLOCK = np.cos(np.arange(N_BLOCKS))


def explanation(names: str, log_evidence: float, *, gained: float = 0.0, estimate: Any = None) -> Any:
    """One whose blocks are predicted better by so much on the average, with a scatter of its own."""
    blocks = -50.0 + gained + (1.0 + 0.1 * len(names)) * PER_BLOCK
    return SimpleNamespace(
        names=frozenset(names),
        added=tuple(SimpleNamespace(name=name, effect=SimpleNamespace(mechanism=MECHANISMS[name])) for name in names),
        evidence=SimpleNamespace(log_evidence=log_evidence, log_evidence_se=0.1 * len(names)),
        cross_validation=CrossValidation(of_blocks=tuple(blocks.tolist()), nrmse=0.1),
        estimate=estimate,
    )


def believed(*explanations: Any) -> Beliefs:
    return Beliefs(explanations=cast(Any, explanations), log_prior=np.zeros(len(explanations)))


def test_a_name_is_borne_out_by_the_best_with_it_against_the_best_without_it() -> None:
    """Student's distribution by hand; a building's explanation with an unnamed force, though it leads, is not asked."""
    forced = explanation("", 90.0, gained=9.0, estimate="a force")
    found = conclusion._borne_out(
        believed(forced, explanation("ab", 89.9, gained=3.0), explanation("b", 89.5, gained=2.9), explanation("", 0.0))
    )
    difference = np.array(3.0 - 2.9 + 0.1 * PER_BLOCK)
    expected = student.cdf(np.mean(difference) / np.std(difference, ddof=1) * np.sqrt(N_BLOCKS), N_BLOCKS - 1)
    assert found["a"] == pytest.approx(expected)
    assert 0.9 < found["a"] < 1.0
    assert found["b"] > 0.999  # against the model as given


def test_another_law_of_the_same_mechanism_is_no_rival() -> None:
    """Which of two laws of wear it is, the evidence tells; that there is wear, the record."""
    every = (explanation("a", 50.0, gained=3.0), explanation("c", 30.0, gained=3.0), explanation("", 0.0))
    found = conclusion._borne_out(believed(*every))
    assert found["a"] > 0.999


def test_improbable_names_are_not_asked() -> None:
    found = conclusion._borne_out(believed(explanation("a", 50.0), explanation("b", 30.0), explanation("", 0.0)))
    assert set(found) == {"a"}


def test_each_name_has_one_probability_wherever_it_is_told() -> None:
    """What was added as the table of effects has it; the others by their law, as far as that is borne out."""
    every = believed(explanation("ab", 50.0), explanation("ac", 50.0), explanation("", 0.0))
    added = SimpleNamespace(hypothesis=SimpleNamespace(name="a"), name_probability=0.3)
    names = conclusion._of_names(every, {"a": 0.9, "b": 0.8}, cast(Any, [added]))
    assert list(names) == ["c", "b", "a"]
    assert names == {"a": 0.3, "b": pytest.approx(0.4), "c": pytest.approx(0.5)}


def test_a_bayes_factor_is_that_of_the_best_with_and_without_the_effect() -> None:
    every = believed(explanation("ab", 50.0), explanation("a", 40.0), explanation("b", 35.0), explanation("", 0.0))
    factor, error = conclusion._bayes_factor("a", every)
    assert (factor, error) == (pytest.approx(15.0), pytest.approx(np.hypot(0.2, 0.1)))
    assert conclusion._bayes_factor("a", believed(explanation("a", 40.0)))[0] == np.inf
