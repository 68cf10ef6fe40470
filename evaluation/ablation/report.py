"""What ``ablate`` found, as a table for the terminal."""

from __future__ import annotations

import math
from typing import Any

from simrig.core.tables import text_table
from simrig.evaluation.ablation.run import Ablation, Row

_COLUMNS = ("bound", "changed", "noise", "ΔE mean", "ΔE max", "PSNR [dB]", "relative")
_SECONDS = ("saved [s]", "expected [s]")


def ablation_tables(result: Ablation) -> list[Any]:
    """Return the rows as a table, with what they are measured against and what follows."""
    unit = result.plan.tolerance.unit
    before = (
        f"tolerance {result.plan.tolerance}; plan: {result.plan.settings_line}\n"
        f"everything: {result.spp:,} samples per pixel, {result.seconds:.2f} s, "
        f"standard error {result.noise:.2g} {unit}\n"
        f"planned render: {result.planned_seconds:.2g} s, expected "
        f"{result.plan.about['render_s']:.2g} s"
    )
    title = f"what each effect changes [{unit}]; noise: what it would be without any change"
    columns = ("effect", "", "plan", *_COLUMNS, *_SECONDS, "note")
    table = text_table(title, columns, map(_cells, result.rows), left=(0, 1, 2, -1))
    return [before, table, _verdict(result)]


def _cells(row: Row) -> tuple[str, ...]:
    bound = "none" if row.bound is None else f"{row.bound:.3g}"
    psnr = row.metrics["psnr"]
    note = f"BOUND TOO SMALL; {row.note}" if row.violated else row.note
    return (
        row.effect,
        row.what,
        "on" if row.on else "off",
        bound,
        f"{row.change.measured:.3g}",
        f"{row.change.noise:.2g}",
        f"{row.metrics['delta_e']:.3g}",
        f"{row.metrics['delta_e_max']:.3g}",
        "∞" if math.isinf(psnr) else f"{psnr:.1f}",
        f"{row.metrics['relative']:.2g}",
        f"{row.saved:.3f}",
        "" if row.expected is None else f"{row.expected:.3f}",
        note,
    )


def _verdict(result: Ablation) -> str:
    checks = sum(row.bound is not None for row in result.rows)
    if not result.violations:
        return f"{checks} bounds checked, none is smaller than what was measured."
    named = ", ".join(f"{row.effect} ({row.what})" for row in result.violations)
    return (
        f"{len(result.violations)} of {checks} bounds are smaller than what was measured, beyond "
        f"noise: {named}. This is a defect of the planner."
    )
