"""What a running master reports of tactels is found by asking it; without one the survey ends too."""

from skinbus.can.event import EventKind
from skinbus.cli.commands.doctor import judge_tactels
from skinbus.master.commissioning.scan import Surveyed, TactelSurvey
from tests.master.rig import Rig

NODE = 1


def survey(rig, ms=500):
    core, events = TactelSurvey([NODE]), []
    rig.wire.attach(core, on_event=events.append)
    rig.run(ms)
    assert [event.kind for event in events] == [EventKind.STOP]
    return core.patches


def test_implausible_tactels_are_counted_by_patch():
    rig = Rig("pad")
    rig.patches.changes[NODE] = lambda tpdo, counts: counts if tpdo else counts * 0 - 0x8000
    rig.run(1500)
    assert survey(rig)[NODE].n_implausible == 4


def test_without_a_master_there_is_nothing_and_an_end():
    rig = Rig("pad")
    rig.wire.detach(rig.wire.ports[1])
    assert survey(rig, 2000) == {}


def test_findings_say_what_to_do():
    found = list(judge_tactels({1: Surveyed(0, 0), 2: Surveyed(3, 0), 3: Surveyed(0, 16)}))
    assert [(f.check, f.found, bool(f.advice)) for f in found] == [
        ("node 2", "3 tactels implausible", True),
        ("node 3", "16 tactels touched since power came", True),
    ]
    (well,) = judge_tactels({1: Surveyed(0, 0)})
    assert not well.advice
    assert not list(judge_tactels({}))
