"""Finished cases of a benchmark are kept; what a kill cut short is run again."""

from pathlib import Path

from benchmarks.importance import Case, finished, keep


def test_cases_are_kept_and_a_torn_line_is_none(tmp_path: Path) -> None:
    path = tmp_path / "cases.jsonl"
    numbers = {"pareto_k": 0.1, "effective": 5.0, "n_solves": 3, "log_evidence": 0.1, "log_evidence_se": 0.2}
    case = Case(
        case=0, method="importance", found=True, silent_miss=False, z={"k": 0.3}, joint_shift_sd=0.1, elapsed_s=1.0,
        **numbers,
    )  # fmt: skip
    keep(path, "first", case)
    keep(path, "second", case)
    whole = path.read_text()
    path.write_text(whole[:-20])
    assert finished(path) == {"first": case}
    keep(path, "second", case)
    assert finished(path) == {"first": case, "second": case}
    keep(None, "second", case)
    assert finished(None) == {}
