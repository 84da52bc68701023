"""A discovery in a few lines of plain text, for the terminal."""

from __future__ import annotations

from bwbn_bayes.discovery.outcome import Added, Discovery
from bwbn_bayes.report.numbers import MINUS, with_uncertainty


def discovery_in_words(discovery: Discovery) -> tuple[str, ...]:
    """The verdict, each effect with its place, evidence and parameters, and the gap, one line each.

    Parameters
    ----------
    discovery : Discovery
        With any verdict.
    """
    gap, apart, changed = discovery.gap, discovery.held_out, bool(discovery.added)
    lines = [f"verdict: {discovery.verdict}", *discovery.sentences]
    for one in discovery.added:
        lines += _effect(one)
    lines.append(_gap("fitted record", gap.before.nrmse, gap.after.nrmse if changed else None, gap.noise_floor))
    if apart and gap.held_out:
        after = gap.held_out.after.nrmse if changed else None
        lines.append(_gap(apart.label, gap.held_out.before.nrmse, after, gap.held_out.noise_floor))
    return tuple(lines)


def _effect(added: Added) -> list[str]:
    hypothesis = added.hypothesis
    factor = f"{added.log_bayes_factor:.1f} +- {added.log_bayes_factor_se:.1f}"
    lines = [f"effect: {added.title}, probability {added.name_probability:.3g}, log Bayes factor {factor}"]
    if alternatives := added.alternatives:
        lines.append(f"    cannot be told from {', '.join(alternatives)}")
        lines += [f"    {sentence}" for sentence in added.separation]
    units = {p.name: p.unit for p in hypothesis.model.space.parameters}
    for name, (mean, sd) in added.moments.items():
        texts = (text.replace(MINUS, "-") for text in with_uncertainty((mean, sd), sd))
        lines.append(f"    {name} = {' +- '.join(texts)} {units[name]}".rstrip())
    return lines


def _gap(label: str, before: float, after: float | None, floor: float) -> str:
    improved = "" if after is None else f" as given, {100.0 * after:.2f} % improved"
    return f"error on the {label}: {100.0 * before:.2f} %{improved}, {100.0 * floor:.2f} % noise alone"
