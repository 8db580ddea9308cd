"""The parts of the verdict: formats, physics, trainers, and what was not tried."""

from __future__ import annotations

from assetbuild.findings import Finding, Rule, finding_from_json
from assetbuild.report.document import make_report
from assetbuild.report.verdict import NOT_RUN, CheckResult, Verdict, judge, verdict_rows

STANDS = {"outcome": "stands", "sentence": "stands", "height_before_m": 0.3, "height_after_m": 0.29}
FALLS = {"outcome": "falls", "sentence": "falls", "height_before_m": 0.74, "height_after_m": 0.16}
TRAINERS = ("isaaclab", "mjlab", "newton")
COMMANDS = {name: f"assetbuild smoke r.yaml --consumer {name}" for name in TRAINERS}


def differs(rule: str, severity: str = "error") -> Finding:
    return Finding(rule, severity, "link trunk", "13 kg, not 12 kg")  # type: ignore[arg-type] # one


def verdict(*findings: Finding, **checks: CheckResult) -> Verdict:
    return judge(findings, checks, COMMANDS)


def lines(judged: Verdict) -> list[str]:
    return [f"{part}: {said}" for part, said in verdict_rows(judged)]


def test_formats_that_differ_are_counted_by_the_rules_of_their_findings():
    """Also one that is waived; a finding of another check is no difference."""
    heavy = Finding("mass.density", "warning", "link trunk", "heavy")
    formats = verdict(differs("equal.mjx.mass"), differs("equal.usd.kp", "info"), heavy).formats
    assert (formats.status, formats.differences) == ("differ", 2)
    assert formats.sentence == "2 findings of the equality checks (mjx, usd)"
    assert (verdict(heavy).formats.status, verdict(heavy).formats.differences) == ("agree", 0)


def test_targets_without_a_check_that_compares_them_are_named():
    left = (
        Finding("formats.not_compared", "info", "target isaaclab", "nothing reads it back"),
        Finding("formats.not_compared", "info", "robot", "", data={"target": ("own", "mine")}),
    )
    formats = verdict(*left).formats
    assert (formats.status, formats.not_compared) == ("not compared", ("isaaclab", "own", "mine"))
    both = verdict(*left, differs("equal.mjcf.mass")).formats
    assert both.status == "differ"
    assert both.sentence.endswith("; not compared: isaaclab, own, mine")


def test_a_format_that_no_simulator_loads_is_not_compared():
    formats = verdict(Finding("equal.mjcf.load", "error", "robot", "refused")).formats
    assert (formats.status, formats.not_compared) == ("not compared", ("mjcf",))


def test_physics_are_what_the_check_that_the_recipe_asks_for_saw():
    """The trials look where it does not."""
    stand, trials = CheckResult("pass", {"stood": STANDS}), CheckResult("pass", {})
    physics = verdict(stand=stand, trials=trials).physics
    assert (physics.status, physics.check) == ("stands", "stand")
    assert (physics.height_before_m, physics.height_after_m) == (0.3, 0.29)
    physics = verdict(trials=CheckResult("pass", {"untouched": FALLS})).physics
    assert (physics.status, physics.check) == ("falls", "trials")


def test_a_robot_that_stands_on_nothing_is_not_said_to_stand_well():
    stand = CheckResult("fail", {"stood": STANDS})
    hovers = Finding("stand.contact", "error", "robot", "nothing touches the floor at the end")
    sentence = verdict(hovers, stand=stand).physics.sentence
    assert sentence == "stands; but nothing touches the floor at the end"


def test_physics_that_nobody_tried_say_why():
    assert verdict().physics.status == "not tried"
    skipped = CheckResult("skip", note="MuJoCo refuses the MJCF")
    assert verdict(trials=skipped).physics.sentence == "MuJoCo refuses the MJCF"


def test_a_trainer_that_was_not_tried_says_the_command_that_tries_it():
    trainers = verdict(smoke_mjlab=CheckResult("skip", note="no environment")).trainers
    assert {one.status for one in trainers.values()} == {"not tried"}
    assert trainers["mjlab"].command == "assetbuild smoke r.yaml --consumer mjlab"


def test_a_trainer_that_was_tried_says_with_what_result():
    ok = CheckResult("pass", {"summary": "0 of 8 robots fell"})
    bad = CheckResult("fail", {"failure": "no such joint"})
    judged = verdict(smoke_mjlab=ok, smoke_newton=bad)
    assert judged.trainers["mjlab"].status == "yes"
    assert judged.trainers["newton"].status == "failed"
    assert lines(judged)[2:] == [
        "trainers: mjlab: yes; 0 of 8 robots fell",
        "trainers: newton: failed; no such joint",
        "trainers: not tried: isaaclab; in the folder of the recipe, "
        "run `assetbuild smoke r.yaml --consumer isaaclab` to try isaaclab",
    ]


def test_a_check_that_was_asked_for_and_did_not_run_blocks_until_it_is_waived():
    missing = NOT_RUN("recipe validate.smoke", "mjlab did not run")
    assert verdict(missing).blocked_by == ("check.not_run",)
    assert not verdict(missing).ready
    waived = Finding(missing.rule, "info", missing.subject, missing.message)
    assert verdict(waived).ready


def test_a_rule_says_itself_whether_its_warnings_block():
    rule = Rule("some.rule", ("warning", "info"), "odd", "mend it", blocks=True)
    told = rule("link a", "odd")
    assert (verdict(told).ready, verdict(told).blocked_by) == (False, ("some.rule",))
    assert verdict(rule("link a", "odd", severity="info")).ready
    assert verdict(rule("link a", "odd", blocks=False)).ready
    assert finding_from_json(told.to_json()) == told
    of_before = {key: value for key, value in told.to_json().items() if key != "blocks"}
    assert not finding_from_json(of_before).blocks


def test_a_check_that_nobody_asked_for_is_only_named():
    judged = verdict(oracle=CheckResult("skip", note="needs `pinocchio`"))
    assert judged.ready
    assert judged.not_tried == {"oracle": "needs `pinocchio`"}
    assert lines(judged)[-1] == "checks: not run: `oracle`: needs `pinocchio`"


def test_the_report_holds_each_part_with_its_status_and_sentence():
    checks = {"stand": CheckResult("fail", {"stood": FALLS})}
    fell = Finding("stand.fall", "error", "robot", "fell")
    told = make_report("r", [fell], checks, {}, lambda _: "", COMMANDS).to_json()["verdict"]
    assert isinstance(told, dict)
    assert {"ready", "blocked_by", "next_step"} < told.keys()
    assert (told["ready"], told["blocked_by"]) == (False, ("stand.fall",))
    assert told["physics"]["status"] == "falls"
    assert told["physics"]["height_after_m"] == 0.16
    assert told["formats"]["status"] == "agree"
    assert told["trainers"]["newton"]["status"] == "not tried"
