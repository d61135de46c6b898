"""The check of a board, run against the JavaScript stack as a device made from our own EDS."""

from skinbus.master.commissioning.patch_check import RULES, Grade, PatchCheck
from skinbus.node.context import NS_PER_MS
from skinbus.objects.eds import load_eds
from tests.interop.peer import resolved_eds

NODE = 9
SURVIVED = [rule for rule in RULES if rule.name not in ("SDO requests", "malformed frames")]
"""An SDO request of three bytes, which the other two send, ends their process."""


def test_their_device_fails_the_rules_that_it_does_not_keep(bench, tmp_path):
    bench.ask("open", id=NODE, eds=str(resolved_eds("skin-patch", NODE, tmp_path)))
    bench.ask("start")
    od = load_eds("skin-patch", NODE)
    check = PatchCheck(NODE, od, 5 * NS_PER_MS, SURVIVED, n_syncs=50, destructive=True)
    bench.attach(check)
    for _ in range(120):
        bench.pass_ms(1000)
        if len(check.results) == len(SURVIVED):
            break
    findings = {result.rule.name: result for result in check.results}
    assert list(findings) == [rule.name for rule in SURVIVED]
    assert {name for name, finding in findings.items() if finding.grade is not Grade.PASS} == {
        "boot-up",
        "SDO aborts",  # four bytes are written to an UNSIGNED16
        "PDO parameters",  # 0x1A00:00 is the number of entries that there are, not of those that are mapped
        "EMCY",
        "configuration mark",
        "pressed",  # nobody is asked
        "guard",
        "LSS",
        "storage",
        "SDO segments",  # the last of an upload of eight bytes is not marked
        "transmission types",  # the event timer does not keep the inhibit time
        "mapping",  # of a valid PDO
        "length of a mapping",
        "SYNC parameters",
        "order of errors",
        "heartbeats of others",
        "guarding",
        "changes",
        "areas of storage",
        "program control",
    }
