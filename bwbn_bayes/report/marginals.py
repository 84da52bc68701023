"""Draw the parameters: posterior against prior, what the record taught, correlations, agreement of chains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from bwbn_bayes.report.canvas import (
    DASHES,
    IDENTIFIED,
    INK,
    PRIOR,
    SERIES,
    Drawing,
    canvas,
    finished,
    legend,
)
from bwbn_bayes.report.numbers import math_symbol, math_unit
from bwbn_bayes.report.pieces import Content, Floats, Marginal, Pair

MAX_MARGINALS = 24
MAX_SCATTER = 1500


def draw_posterior(marginals: tuple[Marginal, ...]) -> Drawing | None:
    """Small multiples of the posterior densities over the prior's, each enlarged to where the posterior lies."""
    drawn = [m for m in marginals if m.posterior.size > 1 and float(np.ptp(m.posterior)) > 0.0][:MAX_MARGINALS]
    if not drawn:
        return None
    n_rows = -(-len(drawn) // 3)
    figure, axes = canvas(n_rows, 0.4 + 1.2 * n_rows, 3, share_x=False)
    for axis, marginal in zip(axes, drawn, strict=False):
        _marginal(axis, marginal)
    for axis in axes[len(drawn) :]:
        axis.set_axis_off()
    with_truth = next((axis for axis, m in zip(axes, drawn, strict=False) if m.parameter.true is not None), axes[0])
    legend(figure, with_truth, axes[-1] if len(axes) > len(drawn) else None)
    rest = f" The first {MAX_MARGINALS} of {len(marginals)} parameters." if len(marginals) > len(drawn) else ""
    return finished(
        figure,
        "posterior.png",
        "Posterior of each parameter, enlarged; the prior lies far below where the record taught much." + rest,
        "Posterior and prior densities of " + ", ".join(m.parameter.name for m in drawn) + ".",
    )


def _marginal(axis: Axes, marginal: Marginal) -> None:
    draws, prior, true = marginal.posterior.ravel(), marginal.prior, marginal.parameter.true
    reach = 0.25 * float(np.ptp(np.percentile(draws, [0.2, 99.8])))
    low, high = float(draws.min()) - reach, float(draws.max()) + reach
    if prior.size > 1:
        low, high = max(low, min(prior.min(), draws.min())), min(high, max(prior.max(), draws.max()))
    grid, density = _density(draws, (low, high))
    axis.fill_between(grid, density, color=IDENTIFIED, alpha=0.3, linewidth=0)
    axis.plot(grid, density, color=IDENTIFIED, linewidth=1.2, label="posterior")
    if prior.size > 1 and float(np.ptp(prior)) > 0.0:
        axis.fill_between(*_density(prior), color=PRIOR, linewidth=0, label="prior", zorder=1)
    if true is not None:
        axis.axvline(true, color=INK, linewidth=1.0, dashes=DASHES, label="true")
        low, high = min(low, true - reach), max(high, true + reach)
    axis.set_xlim(low - 0.3 * reach, high + 0.3 * reach)
    axis.set_ylim(0.0, 1.1 * float(np.max(density)))
    axis.set_yticks([])
    axis.spines["left"].set_visible(False)
    axis.grid(visible=False)
    axis.xaxis.set_major_locator(MaxNLocator(3))
    axis.set_title(math_symbol(marginal.parameter.name) + math_unit(marginal.parameter.unit))


def _density(draws: Floats, ends: tuple[float, float] | None = None) -> tuple[Floats, Floats]:
    """Grid and density of draws, reflected at the ends where given."""
    import arviz as az  # it inspects the whole stack when imported: dear inside other imports

    grid, density, _ = az.kde(draws) if ends is None else az.kde(draws, custom_lims=ends)
    return grid, density


def draw_learned(marginals: tuple[Marginal, ...]) -> Drawing | None:
    """For each parameter, the part of its prior (in prior probability) that the posterior's 90 % occupies."""
    drawn = [m for m in marginals if m.prior.size > 1][: 2 * MAX_MARGINALS]
    if not drawn:
        return None
    figure, (axis,) = canvas(1, 0.8 + 0.24 * len(drawn))
    for row, marginal in enumerate(reversed(drawn)):
        prior = np.sort(marginal.prior)
        share = (np.arange(prior.size) + 0.5) / prior.size
        low, middle, high = np.interp(np.percentile(marginal.posterior, [5, 50, 95]), prior, share)
        axis.plot([0, 1], [row, row], color="#e6e3dd", linewidth=7, solid_capstyle="butt")
        axis.plot([low, high], [row, row], color=IDENTIFIED, linewidth=7, solid_capstyle="butt", alpha=0.55)
        axis.plot(middle, row, "|", color=IDENTIFIED, markersize=11, markeredgewidth=2.2)
        if marginal.parameter.true is not None:
            axis.plot(np.interp(marginal.parameter.true, prior, share), row, "d", color=INK, markersize=3.5)
    axis.set_yticks(range(len(drawn)), [math_symbol(m.parameter.name) for m in reversed(drawn)])
    axis.set_xlim(0, 1)
    axis.set_ylim(-0.7, len(drawn) - 0.3)
    axis.grid(visible=False)
    axis.set_xticks([0, 0.25, 0.5, 0.75, 1.0], ["0", "25 %", "50 %", "75 %", "100 %"])
    axis.set_xlabel("prior probability below")
    diamonds = " Diamonds: true." if any(m.parameter.true is not None for m in drawn) else ""
    return finished(
        figure,
        "learned.png",
        "What the record taught: the 90 % interval of the posterior (blue) inside the whole prior (grey), in prior "
        "probability." + diamonds,
        "For each parameter, the part of its prior that the posterior occupies.",
    )


def draw_pairs(pairs: tuple[Pair, ...]) -> Drawing | None:
    """Scatter of the most correlated parameters."""
    if not pairs:
        return None
    n_columns = min(2, len(pairs))
    n_rows = -(-len(pairs) // 2)
    figure, axes = canvas(n_rows, 0.2 + 2.35 * n_rows, n_columns, share_x=False)
    for axis, pair in zip(axes, pairs, strict=False):
        _scatter(axis, pair)
    for axis in axes[len(pairs) :]:
        axis.set_axis_off()
    names = "; ".join(f"{pair.first.parameter.name} and {pair.second.parameter.name}" for pair in pairs)
    crossing = " Dashed lines cross at the truth." if _any_truth(pairs) else ""
    return finished(
        figure,
        "pairs.png",
        f"The strongest correlations between parameters, one dot for each draw.{crossing}",
        f"Scatter of posterior draws: {names}.",
    )


def _any_truth(pairs: Sequence[Pair]) -> bool:
    return any(m.parameter.true is not None for pair in pairs for m in (pair.first, pair.second))


def _scatter(axis: Axes, pair: Pair) -> None:
    x, y = pair.first.posterior.ravel(), pair.second.posterior.ravel()
    stride = -(-x.size // MAX_SCATTER)
    axis.plot(x[::stride], y[::stride], ".", color=IDENTIFIED, alpha=0.45, markersize=5, markeredgewidth=0)
    if pair.first.parameter.true is not None:
        axis.axvline(pair.first.parameter.true, color=INK, linewidth=0.8, dashes=DASHES)
    if pair.second.parameter.true is not None:
        axis.axhline(pair.second.parameter.true, color=INK, linewidth=0.8, dashes=DASHES)
    axis.set_title(f"correlation {pair.correlation:.2f}".replace("-", "\N{MINUS SIGN}"))
    axis.set_xlabel(math_symbol(pair.first.parameter.name) + math_unit(pair.first.parameter.unit))
    axis.set_ylabel(math_symbol(pair.second.parameter.name) + math_unit(pair.second.parameter.unit))
    axis.xaxis.set_major_locator(MaxNLocator(3))
    axis.yaxis.set_major_locator(MaxNLocator(4))


def draw_chains(content: Content) -> Drawing | None:
    """Rank histograms of the chains, where there are several."""
    drawn = content.marginals[:MAX_MARGINALS]
    if content.n_chains < 2 or not drawn:
        return None
    n_rows = -(-len(drawn) // 3)
    figure, axes = canvas(n_rows, 0.3 + 1.2 * n_rows, 3, share_x=False)
    for axis, marginal in zip(axes, drawn, strict=False):
        n_chains, n_draws = marginal.posterior.shape
        ranks = np.argsort(np.argsort(marginal.posterior, axis=None)).reshape(n_chains, n_draws)
        for chain, colour in zip(ranks, SERIES, strict=False):
            axis.hist(chain, bins=20, range=(0, ranks.size), histtype="step", color=colour, linewidth=1.0)
        axis.axhline(n_draws / 20, color=INK, linewidth=0.8, dashes=DASHES)
        axis.set_title(math_symbol(marginal.parameter.name))
        axis.set_xticks([])
        axis.set_ylim(bottom=0.0)
    for axis in axes[len(drawn) :]:
        axis.set_axis_off()
    return finished(
        figure,
        "chains.png",
        "Ranks of each chain's draws among all draws: flat, near the dashed line, where the chains agree.",
        "Rank histograms of the chains for each parameter.",
    )
