"""Links that exist, near those of a description, with the base parameters of a fit."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from . import moving_arm
from .moving_arm import JOINTS, ROTOR, URDF
from .quick import first_quick

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.arm_estimate import ArmEstimate
from joint_id_core.arm.description import Description
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.links import Links, consistent_links
from joint_id_core.arm.pseudo_inertia import nearest_body, parameters_of, pseudo_inertia
from joint_id_core.arm.regressor import Regressor

GAINS = {name: {"torque": 1.0} for name in JOINTS}
TRUE = Regressor(Description(URDF))
TRUTH = TRUE.composition @ np.concatenate([ROTOR, TRUE.bodies.ravel()])
LENGTHS = np.linspace(0.0, 10.0, 80)


def wrong(seed: int, urdf: str = URDF, share: float = 0.2) -> str:
    """An arm with masses, centres and inertias that are wrong by up to a share."""
    rng = np.random.default_rng(seed)

    def scaled(match: re.Match[str]) -> str:
        factor = 1.0 + share * rng.uniform(-1.0, 1.0)
        return re.sub(r'(?<==")[-\d.]+', lambda number: repr(factor * float(number[0])), match[0])

    text = re.sub(r"<(mass|inertia) [^>]*>", scaled, urdf)
    return re.sub(r'<origin xyz="[^"]*"(?= rpy="0 0 0.3")', scaled, text)


def of(links: Links) -> np.ndarray:
    """Base parameters of links."""
    bodies = [parameters_of(link.found.pseudo_inertia) for link in links.links]
    return np.asarray(TRUE.composition @ np.concatenate([[link.rotor for link in links.links], *bodies]))


@pytest.fixture(scope="module")
def records():
    return [moving_arm.rigid(15.0, seed) for seed in (0, 1)]


@pytest.fixture(scope="module", params=first_quick(range(3)))
def fitted(request, records) -> ArmEstimate:
    return fit_arm(Description(wrong(request.param)), records, GAINS)


def test_what_cancels_in_a_description_leaves_no_rounding():
    """A promise of `design --arm` had a combination of 2.168e-18 kg m."""
    turned = URDF.replace('rpy="0 0 0.3"', f'rpy="{np.pi} 0 0"')
    size = np.abs(Regressor(Description(turned)).reference)
    assert (size[size > 0.0] > 1e-12).all() and (size == 0.0).any()


def test_pseudo_inertias_hold_the_ten_parameters_in_any_frame():
    import pinocchio

    for body in TRUE.bodies:
        np.testing.assert_allclose(parameters_of(pseudo_inertia(body)), body, rtol=1e-12, atol=1e-15)
        place = pinocchio.SE3.Random()
        moved = place.act(pinocchio.Inertia.FromDynamicParameters(body)).toDynamicParameters()
        there = place.homogeneous @ pseudo_inertia(body) @ place.homogeneous.T
        np.testing.assert_allclose(parameters_of(there), moved, rtol=1e-9, atol=1e-12)


def test_an_inertia_that_no_body_has_gives_the_nearest_body():
    plate = pseudo_inertia(np.array([2.0, 0.4, 0.0, 0.2, 0.5, 0.0, 0.01, -0.04, 0.0, 0.02]))
    assert np.linalg.eigvalsh(plate).min() < 0.0
    body = nearest_body(plate)
    assert np.linalg.eigvalsh(body).min() > 0.0
    np.testing.assert_allclose(body[3], plate[3])  # mass and centre
    assert nearest_body(body) is body or np.allclose(nearest_body(body), body)


def test_links_have_the_base_parameters_of_the_fit_and_are_no_farther_from_the_truth(fitted):
    values, sigma = (np.array([getattr(p, name) for p in fitted.parameters]) for name in ("value", "std_dev"))
    moved, from_truth = (of(fitted.links) - values) / sigma, (of(fitted.links) - TRUTH) / sigma
    assert 0.0 < fitted.links.off <= np.sqrt(np.mean(moved**2)) < 1.0
    assert np.abs(moved).max() < 3.0
    assert np.sqrt(np.mean(from_truth**2)) < 1.1 * np.sqrt(np.mean(((values - TRUTH) / sigma) ** 2))
    assert 0.05 < fitted.links.share < 0.5 and not fitted.links.doubts


def test_links_exist_and_masses_are_near_those_of_the_description(fitted):
    for link in fitted.links.links:
        assert np.linalg.eigvalsh(link.found.pseudo_inertia).min() > 0.0 and link.rotor >= 0.0
        assert 0.7 < link.found.mass / link.described.mass < 1.4
    assert fitted.links.links[0].found == fitted.links.links[0].described  # only its Izz turns, and the rotor has more
    assert "column  as described" in str(fitted) and "upper   " in str(fitted)


def test_torques_of_another_motion_are_nearer_than_those_of_the_description(fitted):
    motion = moving_arm.at(LENGTHS, 7)
    truth = moving_arm.inverse(motion) + ROTOR * motion.ddq
    rows = TRUE.rows(motion.q, motion.dq, motion.ddq)[0]
    described = rows @ np.array([p.described for p in fitted.parameters]) + ROTOR * motion.ddq
    left = np.std(rows @ of(fitted.links) - truth, axis=0)
    assert np.all(left < 0.5 * np.std(described - truth, axis=0))
    assert np.all(left < 0.02)  # Nm; of a sample, the noise is 0.05


def test_a_description_that_is_right_is_kept(records):
    found = fit_arm(Description(URDF), records, GAINS).links
    assert found.share < 0.05
    for link in found.links:
        assert abs(link.found.mass / link.described.mass - 1.0) < 0.01 and link.moved < 1e-3


@pytest.mark.long
def test_placeholders_do_not_keep_torques_from_being_right(records):
    same = '<origin xyz="0 0 0" rpy="0 0 0"/><mass value="1"/>\n<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" '
    text = re.sub(r"(?s)<origin [^>]*0.3\"/><mass [^>]*/>\s*<inertia [^>]*>", f'{same}ixz="0" iyz="0"/>', URDF)
    found = fit_arm(Description(text), records, GAINS)
    sigma = np.array([p.std_dev for p in found.parameters])
    assert np.sqrt(np.mean(((of(found.links) - TRUTH) / sigma) ** 2)) < 1.5
    assert all(np.linalg.eigvalsh(link.found.pseudo_inertia).min() > 0.0 for link in found.links.links)
    assert any("a single link is hardly known" in text for text in found.links.doubts)


@pytest.mark.long
def test_an_inertia_that_no_body_has_is_told(records):
    text = URDF.replace('ixx="0.05" iyy="0.065"', 'ixx="0.05" iyy="0.3"')
    assert text != URDF
    found = fit_arm(Description(text), records, GAINS).links
    assert any("link upper of the description has an inertia that no body has" in doubt for doubt in found.doubts)


def noisy(seed: int, size: float, off: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Estimates of the base parameters whose errors are `off` times what their covariance says, and that covariance."""
    rng = np.random.default_rng(seed)
    scale = np.maximum(np.abs(TRUTH), 0.01) * size
    spread = rng.standard_normal((len(TRUTH), len(TRUTH))) * scale[:, None] / np.sqrt(len(TRUTH))
    noise = spread @ rng.standard_normal(len(TRUTH)) + 0.1 * scale * rng.standard_normal(len(TRUTH))
    return TRUTH + off * noise, spread @ spread.T + np.diag((0.1 * scale) ** 2)


ANY = (st.integers(0, 10**6), st.floats(-4.0, -0.5), st.floats(0.0, 2.0))


@settings(max_examples=6, deadline=None)
@given(*ANY)
def test_bodies_exist_whatever_was_estimated(seed, size, off):
    assert_bodies(seed, size, off)


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(*ANY)
def test_many_bodies_exist_whatever_was_estimated(seed, size, off):
    assert_bodies(seed, size, off)


def assert_bodies(seed, size, off):
    values, covariance = noisy(seed, 10.0**size, 10.0**off)
    rotors = np.where(np.random.default_rng(seed).random(len(JOINTS)) < 0.7, ROTOR, 0.0)
    links = consistent_links(TRUE, values, covariance, rotors.tolist())
    for link, rotor in zip(links.links, rotors, strict=True):
        assert np.linalg.eigvalsh(link.found.pseudo_inertia).min() > 0.0
        assert link.rotor > 0.0 if rotor else link.rotor == 0.0


@pytest.mark.parametrize("seed", range(8))
def test_noise_is_no_contradiction(seed):
    values, covariance = noisy(seed, 0.05)
    links = consistent_links(TRUE, values, covariance, ROTOR.tolist())
    left = of(links) - values
    assert left @ np.linalg.solve(covariance, left) < 2.0 * len(TRUTH)
    assert not links.doubts


def test_what_no_bodies_have_is_told():
    sigma = 0.01 * np.maximum(np.abs(TRUTH), 0.01)
    values = TRUTH.copy()
    k = TRUE.combinations.index(next(text for text in TRUE.combinations if text.startswith("Izz of spin")))
    values[k] = -0.01
    links = consistent_links(TRUE, values, np.diag(sigma**2), ROTOR.tolist())
    assert "such as no bodies have" in links.doubts[0] and "Izz of spin" in links.doubts[0]


def test_what_was_not_seen_stays():
    covariance = np.zeros((len(TRUTH), len(TRUTH)))
    k = TRUE.combinations.index(next(text for text in TRUE.combinations if text.startswith("mx of spin")))
    covariance[k, k] = 1e-8
    values = np.full(len(TRUTH), 99.0)
    values[k] = TRUTH[k] + 0.02
    links = consistent_links(TRUE, values, covariance, [0.0] * len(JOINTS))
    assert [link.name for link in links.links if link.found != link.described] == ["plate"]
    assert of(links)[k] == pytest.approx(values[k], abs=2e-4)
