"""What an instrument's calibration leaves, groups of quantities, and alternatives in its file."""

from __future__ import annotations

import copy
import tomllib
from importlib.resources import files
from typing import Any

import pytest

from refusals import refused
from simrig.instruments.calibration import replaced
from simrig.instruments.description import described, shipped
from simrig.instruments.quantity import Quantity, quantities_of

UTIA = tomllib.loads(files("simrig.instruments").joinpath("utia.toml").read_text(encoding="utf-8"))


def changed(table: str, **keys: Any) -> dict[str, Any]:
    made = copy.deepcopy(UTIA)
    where = made[table][0] if isinstance(made[table], list) else made[table]
    where.update(keys)
    return made


def test_every_number_has_a_path() -> None:
    numbers = quantities_of(shipped("utia"))
    assert numbers["axis.phi_v.repeatability_deg"].value == 0.03
    assert numbers["calibration.reference_f_r_per_sr"].u == 0.0008
    assert "u" in numbers["sample.tilt_deg"].model_fields_set


def test_an_alternative_replaces_one_axis_or_all() -> None:
    numbers = quantities_of(shipped("utia"))
    finer, finest = Quantity(value=0.01), Quantity(value=0.001)
    made = replaced(
        numbers, {"axis.repeatability_deg": finer, "axis.phi_i.repeatability_deg": finest}
    )
    assert made["axis.theta_i.repeatability_deg"] == finer
    assert made["axis.phi_i.repeatability_deg"] == finest
    assert {k for k in numbers if made[k] != numbers[k]} == {
        f"axis.{axis}.repeatability_deg" for axis in ("theta_i", "theta_v", "phi_i", "phi_v")
    }


def test_what_cannot_be_is_refused_in_one_line() -> None:
    lamp = {"value": 0.0, "u": 0.1, "group": "lamp"}
    for table, says in (
        (changed("calibration", flat=0.1), "'flat'"),
        (changed("calibration", flat_field={"value": 0, "u": -1}), "u must be >= 0"),
        (changed("calibration", flat_field={"value": 0, "u": float("nan")}), "calibration"),
        (changed("calibration", linearity={"value": 0, "unc": 1}), "unc"),
        (changed("calibration", linearity=7.0), "from -1 to 1"),
        (changed("alternative", price_eur=-1), "must be >= 0"),
        (changed("alternative", replaces={}), "at least one number"),
        (changed("alternative", replaces={"axis.repeatabilty_deg": 0.1}), "repeatability_deg"),
        (changed("alternative", replaces={"camera.mu_sat_e": {"value": 1, "v": 2}}), "'v'"),
        (changed("alternative", name="light with a monitor diode"), "twice"),
        (
            changed("light", drift_pct_h={**lamp, "dist": "uniform"}, stray=lamp),
            "group 'lamp'",
        ),
    ):  # fmt: skip
        refused(says, described, table)


def test_groups_of_one_distribution_are_taken() -> None:
    lamp = {"value": 0.0, "u": 0.1, "group": "lamp"}
    described(changed("light", drift_pct_h=lamp, stray=lamp))
    # no uncertainty, no contradiction
    described(changed("light", drift_pct_h=lamp, stray={**lamp, "u": 0.0, "dist": "uniform"}))


def test_other_kinds_have_no_calibration() -> None:
    with pytest.raises(AttributeError):
        shipped("merkur-gantry").calibration  # type: ignore[attr-defined]  # noqa: B018
