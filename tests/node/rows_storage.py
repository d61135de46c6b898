"""Conformance rows: parameters stored and restored, resets and what they put back."""

from tests.node.node_table import BOTH, PATCH, Row, no, reads, refuses, up, writes

SAVE = "73 61 76 65"
LOAD = "6C 6F 61 64"
BOOT = "<- 700+n 00"
INHIBIT = writes("1015:00", "64 00")
ENABLE = writes("6423:00", "01")
TOUCH = writes("2030:01", "D0 07 00 00")


class BrokenStorage:
    """A memory that cannot be written."""

    def load(self, group):
        return None

    def save(self, group, text):
        raise OSError("write protected")

    def erase(self, group):
        raise OSError("write protected")


class DamagedStorage:
    """A memory whose content has rotted."""

    def load(self, group):
        return "skinbus parameters 1 534B4E42 00005001\n1015:00 6400\n00000000\n"

    def save(self, group, text):
        pass

    def erase(self, group):
        pass


MARK = [*writes("1020:01", "39 30 00 00"), *writes("1020:02", "01 00 00 00")]
MARKED = [*reads("1020:01", "39 30 00 00"), *reads("1020:02", "01 00 00 00")]
UNMARKED = [*reads("1020:01", "00 00 00 00"), *reads("1020:02", "00 00 00 00")]
ROWS = [
    Row("parameters can be saved on command", "301 7.5.2.13", reads("1010:01", "01 00 00 00")),
    Row("the number of ways to save", "301 7.5.2.13", reads("1010:00", "04")),
    Row("defaults can be restored", "301 7.5.2.14", reads("1011:01", "01 00 00 00")),
    Row(
        "without a memory nothing can be saved",
        "301 7.5.2.13",
        reads("1010:01", "00 00 00 00"),
        storage=lambda: None,
    ),
    Row(
        "saving without a memory", "301 7.5.2.13", refuses("1010:01", SAVE, 0x08000021), storage=lambda: None
    ),
    Row("a wrong signature to save", "301 7.5.2.13", refuses("1010:01", "65 76 61 73", 0x08000020)),
    Row("a wrong signature to restore", "301 7.5.2.14", refuses("1011:01", SAVE, 0x08000020)),
    Row("a memory that fails", "301 7.5.2.13", refuses("1010:01", SAVE, 0x06060000), storage=BrokenStorage),
    Row(
        "a memory that cannot be erased",
        "301 7.5.2.14",
        refuses("1011:01", LOAD, 0x06060000),
        storage=BrokenStorage,
    ),
    Row("no sub-index beyond", "301 7.5.2.13", [up("1010:05"), no("1010:05", 0x06090011)]),
    Row(
        "reset node brings the defaults back",
        "301 7.3.2.2.1",
        [
            *INHIBIT,
            *TOUCH,
            "-> 000 81 nn",
            BOOT,
            *reads("1015:00", "00 00"),
            *reads("2030:01", "E8 03 00 00"),
        ],
        on=PATCH,
    ),
    Row(
        "reset communication leaves the application alone",
        "301 7.3.2.2.1",
        [
            *INHIBIT,
            *TOUCH,
            "-> 000 82 nn",
            BOOT,
            *reads("1015:00", "00 00"),
            *reads("2030:01", "D0 07 00 00"),
        ],
        on=PATCH,
    ),
    Row(
        "what is saved is there after reset node",
        "301 7.5.2.13",
        [
            *INHIBIT,
            *writes("1010:01", SAVE),
            *writes("1015:00", "00 00"),
            "-> 000 81 nn",
            BOOT,
            *reads("1015:00", "64 00"),
        ],
    ),
    Row(
        "what is saved is there after power-on",
        "301 7.5.2.13",
        [
            *INHIBIT,
            *TOUCH,
            *ENABLE,
            *writes("1010:01", SAVE),
            "power",
            BOOT,
            *reads("1015:00", "64 00"),
            *reads("2030:01", "D0 07 00 00"),
            *reads("6423:00", "01"),
        ],
        on=PATCH,
    ),
    Row(
        "what is not saved is not there after power-on",
        "301 7.5.2.13",
        [*INHIBIT, "power", BOOT, *reads("1015:00", "00 00")],
    ),
    Row(
        "saving communication parameters alone",
        "301 7.5.2.13",
        [
            *INHIBIT,
            *TOUCH,
            *writes("1010:02", SAVE),
            "power",
            BOOT,
            *reads("1015:00", "64 00"),
            *reads("2030:01", "E8 03 00 00"),
        ],
        on=PATCH,
    ),
    Row(
        "saving application parameters alone",
        "301 7.5.2.13",
        [
            *INHIBIT,
            *ENABLE,
            *writes("1010:03", SAVE),
            "power",
            BOOT,
            *reads("1015:00", "00 00"),
            *reads("6423:00", "01"),
        ],
        on=PATCH,
    ),
    Row(
        "saving manufacturer parameters alone",
        "301 7.5.2.13",
        [
            *ENABLE,
            *TOUCH,
            *writes("1010:04", SAVE),
            "power",
            BOOT,
            *reads("6423:00", "00"),
            *reads("2030:01", "D0 07 00 00"),
        ],
        on=PATCH,
    ),
    Row(
        "restoring takes effect with the reset",
        "301 7.5.2.14",
        [
            *INHIBIT,
            *writes("1010:01", SAVE),
            *writes("1011:01", LOAD),
            *reads("1015:00", "64 00"),
            "-> 000 81 nn",
            BOOT,
            *reads("1015:00", "00 00"),
        ],
    ),
    Row(
        "restoring one group keeps the others",
        "301 7.5.2.14",
        [
            *INHIBIT,
            *TOUCH,
            *writes("1010:01", SAVE),
            *writes("1011:02", LOAD),
            "power",
            BOOT,
            *reads("1015:00", "00 00"),
            *reads("2030:01", "D0 07 00 00"),
        ],
        on=PATCH,
    ),
    Row(
        "a saved PDO is sent as saved",
        "301 7.5.2.13",
        [
            *writes("1800:02", "02"),
            *writes("1010:01", SAVE),
            "power",
            BOOT,
            "-> 000 01 nn",
            "-> 080",
            *[f"<- {base}80+n 00 00 00 00 00 00 00 00" for base in "234"],
        ],
        on=PATCH,
    ),
    Row(
        "the serial number is the device's own",
        "301 7.5.2.21",
        ["-> 000 81 nn", BOOT, *reads("1018:04", "EE FF C0 00")],
    ),
    Row(
        "a damaged memory is an error, and the defaults hold",
        "301 7.5.2.13",
        ["-> 000 81 nn", BOOT, "<- 080+n 00 63 01 00 00 00 00 00", *reads("1015:00", "00 00")],
        on=BOTH,
        storage=DamagedStorage,
    ),
    Row(
        "a command leaves the mark",
        "301 7.5.2.13",
        [*writes("2050:00", "01 00 00 00"), *writes("1010:01", SAVE)],
        on=PATCH,
    ),
    Row("the configuration is marked", "301 7.5.2.24", [*TOUCH, *MARK, *MARKED], on=PATCH),
    Row("a change takes the mark away", "301 7.5.2.24", [*MARK, *TOUCH, *UNMARKED], on=PATCH),
    Row("of the communication too", "301 7.5.2.24", [*MARK, *INHIBIT, *UNMARKED], on=PATCH),
    Row("the same value again leaves the mark", "301 7.5.2.24", [*TOUCH, *MARK, *TOUCH, *MARKED], on=PATCH),
    Row(
        "a command is no parameter",
        "301 7.5.2.24",
        [*MARK, *writes("2050:00", "01 00 00 00"), *writes("1003:00", "00"), *MARKED],
        on=PATCH,
    ),
    Row(
        "what is refused leaves the mark",
        "301 7.5.2.24",
        [*MARK, *refuses("1029:01", "03", 0x06090031), *MARKED],
        on=PATCH,
    ),
    Row(
        "a stored mark is back with all that was stored",
        "301 7.5.2.24",
        [
            *MARK,
            *writes("1010:01", SAVE),
            *TOUCH,
            "-> 000 82 nn ; of which a reset of the communication brings back a part",
            BOOT,
            *UNMARKED,
            "-> 000 81 nn",
            BOOT,
            *MARKED,
        ],
        on=PATCH,
    ),
    Row(
        "a mark that is stored with a change is that of the change",
        "301 7.5.2.24",
        [*MARK, *TOUCH, *writes("1010:01", SAVE), "power", BOOT, *UNMARKED],
        on=PATCH,
    ),
    Row(
        "restoring a part takes the stored mark away",
        "301 7.5.2.24",
        [*TOUCH, *MARK, *writes("1010:01", SAVE), *writes("1011:04", LOAD), "power", BOOT, *UNMARKED],
        on=PATCH,
    ),
    Row(
        "and so does storing a part",
        "301 7.5.2.24",
        [*MARK, *writes("1010:01", SAVE), *TOUCH, *writes("1010:04", SAVE), "power", BOOT, *UNMARKED],
        on=PATCH,
    ),
    Row(
        "but not one of what is marked",
        "301 7.5.2.24",
        [
            *TOUCH,
            *MARK,
            *[step for sub in (2, 3, 4) for step in writes(f"1010:{sub:02}", SAVE)],
            "power",
            BOOT,
            *MARKED,
        ],
        on=PATCH,
    ),
]
