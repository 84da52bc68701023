"""No evidence feels the step by which a model was solved; records are solved by SciPy, which shares no code with it."""

from dataclasses import replace

import numpy as np
import pytest

from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.scheme import finely_solved
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.inference.accuracy import LADDER, choose_scheme, rung_of
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.parameters import Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.records.noise import add_noise
from bwbn_bayes.structures.parts import Links
from bwbn_bayes.structures.structure import Structure

TRUTH = {"k[1]": 40.0, "alpha[1]": 0.1}
CHANNELS = ("acceleration_1", "acceleration_2")


def building(stiff: float) -> Structure:
    """Two storeys; the upper one is known and linear, its period 0.14 s where its stiffness is 1,000 N/m."""
    lower = BoucWen(k=Uniform(20, 80), c=0.2, alpha=Uniform(0.01, 0.3), beta=8.0, gamma=2.0, n=1.6)
    links = (Links(element=lower, joins=((0, 1),)), Links(element=Linear(k=stiff, c=0.5), joins=((1, 2),)))
    return Structure(masses=(1.0, 1.0), links=links)


PLAIN, STIFF = building(40.0), building(1e3)
COARSE = replace(LADDER[0], n_threads=1)


def explained(model: Structure, engine: object = COARSE) -> Explanation:
    """The right model, fitted from the truth to 25 s of its response at 40 dB."""
    values = np.array([[TRUTH[name] for name in model.space.names]])
    ground = el_centro("chopra", duration=25.0)
    clean = Reference().simulate(model, values, ground, CHANNELS).values[0]
    record = ground.with_channels(dict(zip(CHANNELS, clean, strict=True)))
    record = add_noise(record, 40.0, np.random.default_rng(3))
    posterior = Posterior(model=model, record=record, engine=engine, noise=default_noise(record))  # type: ignore[arg-type]
    modes = distinct(*polish(posterior, model.space.to_unit(values), n_iterations=20))
    return Explanation(added=(), posterior=posterior, modes=modes, evidence=laplace(posterior, modes))


@pytest.fixture(scope="module")
def stiff() -> Explanation:
    return explained(STIFF)


def test_a_law_that_feels_the_step_is_solved_more_finely(stiff: Explanation) -> None:
    exact = explained(STIFF, replace(LADDER[-1], n_threads=1)).evidence.log_evidence
    assert abs(stiff.evidence.log_evidence - exact) > 10.0
    finer = finely_solved(stiff)
    assert rung_of(finer.posterior.engine) > 0  # type: ignore[arg-type]
    assert abs(finer.evidence.log_evidence - exact) < 1.0
    assert finely_solved(finer) is finer


def test_a_law_that_does_not_feel_it_stays_as_it_was() -> None:
    plain = explained(PLAIN)
    assert finely_solved(plain) is plain


def test_the_choice_begins_at_the_rung_that_it_is_given() -> None:
    plain = explained(PLAIN)
    for rung in range(3):
        engine = replace(LADDER[rung], n_threads=1)
        assert rung_of(engine) == rung
        assert choose_scheme(plain.posterior, plain.best, engine, first=rung)[0] == engine
