"""Significant digits, units and symbols."""

import math

import pytest

from bwbn_bayes.report.numbers import (
    display_scale,
    duration,
    html_symbol,
    html_unit,
    math_symbol,
    math_unit,
    percent,
    significant,
    with_uncertainty,
)


@pytest.mark.parametrize(
    ("mean", "sd", "expected"),
    [
        (19.98273, 0.2263, ("19.98", "0.23")),
        (0.0204142, 0.00123, ("0.0204", "0.0012")),
        (2.0, 0.0996, ("2.00", "0.10")),
        (-12.3456, 3.21, ("−12.3", "3.2")),
        (12345.6, 123.4, ("12350", "120")),
        (23456789.0, 12345.0, ("2.3457 × 10⁷", "0.0012 × 10⁷")),
        (0.000012346, 0.00000012, ("1.235 × 10⁻⁵", "0.012 × 10⁻⁵")),
        (0.001, 0.5, ("0.00", "0.50")),
        (-0.001, 0.5, ("0.00", "0.50")),
    ],
)
def test_sd_has_two_digits_and_the_mean_ends_at_the_same_place(mean, sd, expected):
    found = tuple(text.replace("\N{THIN SPACE}", " ") for text in with_uncertainty((mean, sd), sd))
    assert found == expected


def test_missing_values_and_zero_uncertainty():
    assert with_uncertainty((1.5, math.nan), 0.1) == ("1.50", "–")
    assert with_uncertainty((1.23456, 0.0), 0.0) == ("1.235", "0")
    assert with_uncertainty((1.0, math.nan), math.nan) == ("1", "–")


def test_an_uncertainty_below_rounding_adds_no_digits():
    """A parameter of 1e20 per metre to the power n, of a posterior of one draw, was printed with 21 digits."""
    found = tuple(text.replace("\N{THIN SPACE}", " ") for text in with_uncertainty((1.234e20, 5.0), 5.0))
    assert found == ("1.234 × 10²⁰", "5")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.0, "0"),
        (1180.0, "1180"),
        (9.9996, "10"),
        (-0.5, "−0.5"),
        (math.inf, "∞"),
        (math.nan, "–"),
        (1e-7, "1 × 10⁻⁷"),
    ],
)
def test_significant(value, expected):
    assert significant(value).replace("\N{THIN SPACE}", " ") == expected


def test_percent_and_duration():
    assert percent(0.04) == "4.0\N{NO-BREAK SPACE}%"
    assert percent(0.00312) == "0.31\N{NO-BREAK SPACE}%"
    assert duration(58.42) == "58.4\N{NO-BREAK SPACE}s"
    assert duration(600.0) == "10\N{NO-BREAK SPACE}min"
    assert duration(64901.0) == "18\N{NO-BREAK SPACE}h"


def test_display_scale_keeps_the_value():
    assert display_scale("m", 0.012) == ("mm", 1e3)
    assert display_scale("m", 0.3) == ("m", 1.0)
    assert display_scale("N", 2.5e5) == ("kN", 1e-3)
    assert display_scale("J", 2.5e8) == ("MJ", 1e-6)
    assert display_scale("m/s^2", 1e-6) == ("m/s^2", 1.0)


def test_symbols_and_units():
    assert html_symbol("k[2]") == "<i>k</i><sub>2</sub>"
    assert html_symbol("delta_nu") == "<i>δ</i><sub>ν</sub>"
    assert math_symbol("delta_nu[3]") == r"$δ_{ν,3}$"
    assert html_unit("m/s^2") == "m/s<sup>2</sup>"
    assert math_unit("") == ""
    assert math_unit("1/m^n") == " [1/m$^{n}$]"


def test_strange_names_are_escaped():
    assert "<script>" not in html_symbol("<script>[1]")
    assert "&lt;b&gt;" in html_unit("<b>")
    assert math_symbol(r"a$b\x^{") == r"$\mathrm{abx}$"
