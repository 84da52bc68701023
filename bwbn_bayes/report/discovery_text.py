"""A discovery in a few lines of plain text, for the terminal."""

from __future__ import annotations

from bwbn_bayes.discovery.outcome import Added, Discovery
from bwbn_bayes.report.numbers import MINUS, with_uncertainty


def discovery_in_words(discovery: Discovery) -> tuple[str, ...]:
    """The verdict, what is behind it, one sentence a line, and the sizes of what was added.

    Parameters
    ----------
    discovery : Discovery
        With any verdict.
    """
    sizes = [line for one in discovery.added for line in _effect(one)]
    return (f"verdict: {discovery.verdict}", *discovery.sentences, *sizes)


def _effect(added: Added) -> list[str]:
    lines = [f"{added.title}:", *(f"    {sentence}" for sentence in added.separation)]
    units = {p.name: p.unit for p in added.hypothesis.model.space.parameters}
    for name, (mean, sd) in added.moments.items():
        texts = (text.replace(MINUS, "-") for text in with_uncertainty((mean, sd), sd))
        lines.append(f"    {name} = {' +- '.join(texts)} {units[name]}".rstrip())
    return lines
