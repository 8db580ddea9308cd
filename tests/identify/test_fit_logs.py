"""Parameters that were hidden in a log come out of it, those that it does not show are refused."""

import mujoco
import numpy as np
import pytest
from logs import (
    JOINTS,
    RATE_HZ,
    assert_found,
    chirps,
    fitted,
    recorded,
    text_of_two_links,
    truth,
    two_links,
)

from assetbuild.errors import StepError
from assetbuild.identify import solve
from assetbuild.identify.fit_logs import _findings
from assetbuild.identify.plant import _whole_steps
from assetbuild.identify.record import Record
from assetbuild.identify.solve import LACKS
from assetbuild.robot.identify import Fit, Parameter, Prediction


@pytest.mark.slow
def test_hidden_parameters_come_out_within_their_intervals(tmp_path):
    target, position, _ = two_links(16.0)
    fit, findings = fitted(tmp_path, target, position)
    assert len(fit.parameters) == 7 and not findings
    assert_found(fit.parameters)
    assert all(p.after < 0.1 * p.before for p in fit.predictions)


@pytest.mark.slow
def test_a_beginning_that_misleads_is_not_the_last_word(tmp_path, monkeypatch):
    """Joints that stick for good move for no parameter: the regression begins anew."""
    monkeypatch.setattr(solve, "approach", lambda problem: np.full_like(problem.start, 40.0))
    target, position, _ = two_links(8.0)
    fit, _ = fitted(tmp_path, target, position)
    called = [each for each in fit.parameters if not each.refused]
    assert len(called) >= 5
    assert all(each.value == pytest.approx(truth(each), rel=0.05) for each in called)


@pytest.mark.slow
def test_the_same_log_gives_the_same_bytes(tmp_path):
    target, position, _ = two_links(6.0)
    texts = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        fitted(folder, target, position)
        texts += [(folder / "out/fit.json").read_bytes()]
    assert texts[0] == texts[1]


@pytest.mark.slow
def test_drive_damping_and_joint_damping_are_one_without_a_torque(tmp_path):
    target, position, torque = two_links(20.0)
    torque = torque + np.random.default_rng(1).normal(0.0, 0.1, torque.shape)
    names = ("armature", "damping", "friction", "kd", "delay")
    fit = tuple((joint, names) for joint in JOINTS)
    plain, findings = fitted(tmp_path / "plain", target, position, fit=fit)
    refused = {(p.name, p.joints[0]): p.refused for p in plain.parameters}
    assert "together with kd" in refused["damping", "shoulder"]
    assert "together with damping" in refused["kd", "shoulder"]
    assert "identify.refused" in {finding.rule for finding in findings}
    measured, _ = fitted(tmp_path / "torque", target, position, torque, fit=fit)
    both = [p for p in measured.parameters if p.name in ("damping", "kd")]
    assert [p.value for p in both] == pytest.approx([truth(p) for p in both], rel=0.1)
    assert all(p.low <= truth(p) <= p.high for p in both)
    assert all("together" not in p.refused for p in both)


def test_a_joint_at_rest_shows_nothing(tmp_path):
    text = text_of_two_links(0.0005)
    target = chirps(6.0)
    target[:, 1] = 0.3
    position, _ = recorded(mujoco.MjModel.from_xml_string(text), target)
    names = ("armature", "damping", "friction")
    fit, _ = fitted(tmp_path, target, position, fit=(("shoulder", ()), ("elbow", names)))
    assert all(each.refused for each in fit.parameters if each.name != "damping")


@pytest.mark.parametrize(
    ("prior", "refused", "after", "rules"),
    [
        (0.3, "", 0.5, []),
        (0.3, "too much noise", 0.5, ["identify.refused"]),
        (0.6, "too much noise", 0.5, ["identify.refused", "identify.prior"]),
        (0.6, f"the model misses the log by 0.1, so it {LACKS}", 0.5, ["identify.refused"]),
        (0.6, "together with kd", 0.5, ["identify.refused"]),
        (0.3, "", 1.04, []),
        (0.3, "", 1.06, ["identify.worse"]),
    ],
)
def test_what_the_logs_contradict_or_predict_no_better_is_told(
    prior: float, refused: str, after: float, rules: list[str]
):
    """The logs allow 0.2 to 0.4 N m; the priors miss the held-out part by 1 rad."""
    friction = Parameter("friction", ("elbow",), 0.3, 0.2, 0.4, prior, refused, "N m")
    fit = Fit((), (friction,), (Prediction("elbow", 0.5, 1.0, after),))
    assert [finding.rule for finding in _findings(fit)] == rules


@pytest.mark.slow
def test_joints_that_no_log_holds_stay_and_change_nothing(tmp_path):
    """The elbow is bolted at 0 in the recording and is not in the log."""
    spec = mujoco.MjSpec.from_string(text_of_two_links())
    spec.delete(spec.joint("elbow"))
    spec.delete(spec.actuators[1])
    target = chirps(12.0, joints=1)
    position, _ = recorded(spec.compile(), target)
    names = ("armature", "damping", "friction", "delay")
    fit, findings = fitted(
        tmp_path, target, position, joints=("shoulder",), fit=(("shoulder", names),)
    )
    assert not findings
    assert [p.value for p in fit.parameters] == pytest.approx(
        [truth(p) for p in fit.parameters], rel=0.05
    )


def test_a_log_that_the_model_cannot_follow_says_by_how_much(tmp_path):
    """The elbow shakes by 20 mrad, by nothing that the model has."""
    target, position, _ = two_links(6.0)
    position[:, 1] += 0.02 * np.sin(2 * np.pi * 3.0 * np.arange(len(position)) / RATE_HZ)
    fit, findings = fitted(
        tmp_path, target, position, fit=(("elbow", ("armature",)), ("shoulder", ()))
    )
    (armature,) = fit.parameters
    assert "the model misses the log by" in armature.refused
    assert "did the robot carry" in findings[0].hint


@pytest.mark.slow
def test_a_joint_whose_friction_seems_to_be_0_is_not_believed(tmp_path):
    text = text_of_two_links(friction=(0.4, 0.0))
    target = chirps(12.0)
    position, _ = recorded(mujoco.MjModel.from_xml_string(text), target)
    fit, _ = fitted(tmp_path / "with", target, position)
    of_elbow = {p.name: p for p in fit.parameters if p.joints == ("elbow",)}
    assert "the best friction of the joint is 0" in of_elbow["damping"].refused
    assert of_elbow["friction"].refused and of_elbow["armature"].refused


def test_joints_that_share_a_value_have_one_value(tmp_path):
    target, position, _ = two_links(6.0)
    names = tuple((joint, ("friction",)) for joint in JOINTS)
    fit, _ = fitted(tmp_path, target, position, fit=names, shared=(".*",))
    (both,) = fit.parameters
    assert both.joints == JOINTS and both.value > 0.0


@pytest.mark.parametrize(("step_s", "steps"), [(0.001, 5), (0.005, 1), (0.003, 0), (0.5, 0)])
def test_the_steps_of_a_simulator_fill_the_time_between_samples(step_s: float, steps: int):
    record = Record(0.005, np.zeros((9, 1)), np.zeros((9, 1)))
    if steps:
        assert _whole_steps(record, step_s) == steps
        return
    with pytest.raises(StepError, match=r"does not go into the 0\.005 s"):
        _whole_steps(record, step_s)
