"""What is wrong in the words of a command is said in one message with status 2, and no file changes."""

import os
import signal
import sys

import pytest

from skinbus.can.candump import format_line
from skinbus.can.frame import Frame
from skinbus.cli import main
from skinbus.config.arm_file import find_arm
from skinbus.objects.eds import find_eds
from tests.files import put
from tests.gateway.doubles import write_scene
from tests.objects.test_module_board import EIGHT_INPUTS

REFUSED = """
demmo                                                   -> Did you mean 'demo'
demo --level best                                       -> best | kmeans
run forarm                                              -> forarm | forearm | pad
run forearm --interface sockatcan                       -> sockatcan | socketcan
run forearm --seconds -1                                -> --seconds | x>0
run pad --seconds nan                                   -> not a finite number
run pad --seconds inf                                   -> not a finite number
run pad --budget-us nan                                 -> not a finite number
run pad --state /proc/x                                 -> /proc/x
run my.toml --state board.eds                           -> would be lost
run pad --state notes.txt                               -> notes.txt is there already
run pad --state x                                       -> x.health is there already
run pad --state y                                       -> y.1 is there already
run bad.toml                                            -> bitrate | rate_hz | surface | node_id | angel_deg
sim forarm                                              -> forarm | forearm
monitor pad --interface sockatcan                       -> sockatcan | socketcan
plan pad --bitrate 623456                               -> 125000
plan none.toml                                          -> wanted a file that can be read, or one of arm
study paper --out /proc/figures                         -> /proc/figures
study arm --out my.toml                                 -> my.toml
board lint none.eds                                     -> an EDS or DCF file that can be read, or one of
board new --grid 6 --pitch-mm 8 --out x.eds             -> '6' is no grid
board new --grid 6x --pitch-mm 8 --out x.eds            -> '6x' is no grid
board new --grid 9x9 --pitch-mm 8 --out x.eds           -> 64
board new --grid 0x4 --pitch-mm 8 --out x.eds           -> 0 tactels; wanted 1 to 64
board new --grid 4x4 --pitch-mm 8 --full-scale-kpa inf --out x.eds       -> full scale of inf kPa
board new --grid 4x4 --pitch-mm 8 --full-scale-kpa nan --out x.eds       -> full scale of nan kPa
board new --grid 4x4 --pitch-mm 8 --full-scale-kpa -60 --out x.eds       -> full scale of -60 kPa
board new --grid 4x4 --pitch-mm 8 --full-scale-kpa 0 --out x.eds         -> full scale of 0 kPa
board new --grid 4x4 --pitch-mm 8 --full-scale-kpa 1e12 --out x.eds      -> full scale of 1e+12 kPa
board new --grid 4x4 --pitch-mm 8 --out board.eds       -> is there already; it would be lost
board new --positions t1.csv --out x.eds                -> u_mm
board new --positions t2.csv --out x.eds                -> line 2, v_mm
board new --positions t3.csv --out x.eds                -> rows 2 and 3
board new --positions t7.csv --pitch-mm 8 --out x.eds   -> rows 1 and 3 | mm apart
board new --positions t8.csv --out x.eds                -> 30000 tactels; wanted 1 to 64
board new --positions t4.csv --out x.eds                -> pitch of inf mm
board new --positions t5.csv --pitch-mm 8 --out x.eds   -> 1 at least
board new --positions t6.csv --pitch-mm 8 --out x.eds   -> normal 1
board new --positions t4.csv --grid 4x4 --out x.eds     -> wanted --grid with --pitch-mm, or --positions
board new --grid 4x2 --pitch-mm 10 --full-scale-kpa 500 --module notes.txt --out x.dcf   -> wanted an EDS
board new --grid 3x2 --pitch-mm 10 --full-scale-kpa 500 --module module.eds --out x.dcf  -> TPDOs
scene check scene-bad.toml                              -> 3 faults | scene.duration_s | effect.nois | loss.
doctor nosuch                                           -> nosuch: 1 fault
doctor health pad --state none                          -> skinbus run --state
doctor health pad --state sick                          -> damaged
scan identify pad                                       -> --out
scan identify link.csv                                  -> symbolic link
doctor forearm --interface slcan --unit                 -> the unit is for SocketCAN
view forearm --attach x --channel can0                  -> no bus is used
view pad --zero                                         -> --zero is for a recording
view pad --host 192.0.2.1                               -> 192.0.2.1: wanted an address of this machine
view two-finger                                         -> scene: is 'two-finger' | 'two-fingers'
view empty.log                                          -> a recording needs --arm
view empty.log.gz                                       -> a recording needs --arm
gateway icub-mtb4 plate.toml --from can0 --to can0      -> both socketcan can0
patch skin-patch --node 5 --reader made_up_pad          -> wanted MODULE:FUNCTION
patch skin-patch --node 5 --reader no_such_module:read  -> No module named 'no_such_module'
patch skin-patch --node 5 --reader math:no_such         -> no_such
patch skin-patch --node 5 --reader math:pi              -> math:pi is of type float; wanted a function

calibrate pad none.csv --out none.dcf                   -> one that can be read (No such file
calibrate my.toml my.toml --out my.toml                 -> .dcf
calibrate my.toml my.toml --out board.dcf               -> would be lost
calibrate my.toml p1.csv --out x.dcf                    -> line 1: wanted a column 'node_id', of node_id
calibrate my.toml p2.csv --out x.dcf                    -> line 1: wanted a column 'p1'
calibrate my.toml p3.csv --out x.dcf                    -> line 1: is 's [mm]'; wanted a column 's_mm'
calibrate my.toml p4.csv --out x.dcf                    -> is 'force'; wanted a column 'force_n'
calibrate my.toml p5.csv --out x.dcf                    -> wanted presses
calibrate my.toml p6.csv --out x.dcf                    -> divided by ';'"; wanted commas between columns
calibrate my.toml p7.csv --out x.dcf                    -> wanted commas between columns
calibrate my.toml p8.csv --out x.dcf                    -> line 2, a_mm: is 'zero'; wanted a number \
| line 3, node_id: is '9'; wanted a patch of the arm | line 4, s_mm: wanted a number \
| line 5, p1: is '1O0'; wanted a number | line 6: is 'no reading'; wanted some of p1 to p16 \
| line 7: is '7 values'; wanted 6 values, as in line 1 | line 10, force_n: is -1.0; wanted a positive number \
| force_n: is 'empty in 1 of 4 presses'
calibrate my.toml p9.csv --out x.dcf                    -> is "2 columns 'force_n'"; wanted each column once
calibrate my.toml p10.csv --out x.dcf                   -> line 1: wanted a line of a table: field larger than
calibrate my.toml p11.csv --out x.dcf                   -> line 2, p1: is '1e308'; wanted a number, at most
calibrate my.toml p12.csv --out x.dcf                   -> line 2, n1: is '1e308'; wanted a number, at most
calibrate locate my.toml p8.csv                         -> line 3, node_id
calibrate locate pad p8.csv --write                     -> pad
calibrate presses field.log --arm pad --poses poses.csv --out x.csv      -> line 3, s_mm: is 'x' | line 4:
calibrate locate my.toml robot.csv --out board.dcf      -> would be lost
calibrate presses x.log --arm pad --poses none.csv --out x.csv           -> one that can be read (No such file
calibrate presses field.log --arm pad --poses robot.csv --out robot.csv  -> would be lost
calibrate presses --out robot.csv field.log --arm pad --poses robot.csv  -> would be lost
scan identify my.toml --out board.dcf                   -> would be lost

record old.log --interface virtual                      -> is there already
record /no/such/folder/x.log                            -> cannot write /no/such/folder/x.log
record new.log -c a -c a                                -> a channel is given twice
record new.log -c upper=a -c grip=b                     -> give --arm
record new.log --interface sockatcan                    -> did you mean socketcan
record new.log --seconds 0                              -> --seconds
record new.log --arm arm-two-buses                      -> bus upper has no channel

replay none.log --arm pad                               -> none.log | can be read (No such file or directory)
replay field.log                                        -> --arm
replay field.log --arm pod                              -> pod | pad
replay field.log --arm field.log                        -> line 1
replay field.log --arm arm-two-buses                    -> can0 | --channel upper= | --channel lower=
replay field.log --arm pad -c can0 -c can1              -> 2 channels
replay field.log --arm pad --out /no/such/folder/x.csv  -> /no/such/folder
replay field.log --arm pad --out field.log              -> would be lost
replay field.log --arm pad --out my.toml                -> would be lost
replay field.log --arm pad --out link.csv               -> symbolic link
replay pauses.log --arm pad                             -> times | go back | candump -l
replay binary --arm pad                                 -> binary | fault | candump
replay empty.log --arm pad                              -> empty

export field.log --arm pad                              -> --out
export field.log --arm pad --out x.csv                  -> .mcap
export field.log --out x.mcap                           -> --arm
export field.log --arm nobody --out x.mcap              -> nobody
export field.log --arm pad --out link.mcap              -> symbolic link
export field.log --arm pad --out no/such/x.mcap         -> cannot write
export none.log --arm pad --out x.mcap                  -> No such file
export empty.log --arm pad --out x.mcap                 -> empty
export field.log --arm pad --out x.dbc                  -> arm alone
export --arm pad --out x.dbc --zero                     -> arm alone
export --arm pad --out x.mcap                           -> give the recording
export --arm pad --out x.txt                            -> .dbc
"""


TACTELS = [
    "u,v\n1,2\n",
    "u_mm,v_mm\n1,x\n",
    "u_mm,v_mm\n4,2\n1,2\n1,2\n",
    "u_mm,v_mm\n1,2\n",
    "u_mm,v_mm\n",
    "x_m,y_m,z_m,nx,ny,nz\n0,0,0,0,0,0\n",
    "x_mm,y_mm,z_mm,nx,ny,nz\n9,9,0,0,0,1\n0,0,0,0,0,1\n9,9.05,0,0,0,1\n",
    "u_mm,v_mm\n" + "\n".join(f"{k},0" for k in range(30_000)),
]
PRESSES = [
    "",
    "node_id,s_mm,force_n\n",
    "Node,s [mm],a,F,P1\n",
    "node_id,s_mm,a_mm,force,p1\n",
    "node_id,s_mm,a_mm,p1\n",
    "node_id;s_mm;a_mm;p1\n3;10,5;0;5\n",
    "node_id\ts_mm\ta_mm\tp1\n",
    "node_id,s_mm,a_mm,force_n,p1,p2\n1,10,zero,5,100,200\n9,10,0,5,100,200\n1,,0,1,100,200\n1,10,0,,1O0,200\n"
    "1,10,0,5,,\n1,10,0,5,1,2,3\n1,10,0,5,1,2\n1,10,0,,1,2\n1,10,0,-1,100,200\n",
    "node_id,s_mm,a_mm,force_n,force_n,p1\n1,25,0,5,5,100\n",
    "node_id,s_mm,a_mm,force_n,p1," + "x" * 200_000 + "\n1,25,0,5,5,100\n",
    "node_id,s_mm,a_mm,force_n,p1,n1\n1,25,0,5,1e308,1\n",
    "node_id,s_mm,a_mm,force_n,p1,n1\n1,25,0,5,100,1e308\n",
]


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def files(tmp_path_factory, field):
    """A folder with files of a user, and what they hold: one for all commands, since none changes a file."""
    folder = tmp_path_factory.mktemp("files")
    write_scene(folder, ["2.0"], 5, 2)
    pauses = [format_line(Frame(0x80, b"", k * 2311 % 7000 * 1000)) for k in range(1000)]
    files = {
        "board.dcf": find_eds("skin-patch").read_text(),
        "my.toml": find_arm("pad").read_text().replace('"skin-patch"', '"board.dcf"'),
        "bad.toml": '[arm]\nname = "bad"\nbitrate = "fast"\nrate_hz = -1\n'
        '[[link]]\nname = "l"\nsurface = "sphere"\nlength_mm = 100\n'
        '[[patch]]\nnode_id = 300\nlink = "m"\ns_mm = 10\nangel_deg = 3\n',
        "robot.csv": "t_s,s_mm,a_mm\n0,1,2\n",
        "module.eds": EIGHT_INPUTS.read_text(),
        "scene-bad.toml": '[scene]\narm = "pad"\nduration_s = -1\n'
        "[effect.nois]\n[effect.loss]\nprobability = 2\n",
        "poses.csv": "t_s,s_mm,a_mm\n0,1,2\n0.1,x,2\n0.2,1\n",
        **{f"t{k}.csv": text for k, text in enumerate(TACTELS, 1)},
        **{f"p{k}.csv": text for k, text in enumerate(PRESSES, 1)},
        "pauses.log": "\n".join([*pauses, ""]),
        "old.log": "old",
        "sick.health": "skinbus-state 1 x 5\nabcde",
        **dict.fromkeys(("notes.txt", "x.health", "y.1"), "mine"),
        "empty.log": "",
        "empty.log.gz": "",
        "field.log": field.read_text(),
    }
    for name, text in files.items():
        put(folder, name, text)
    (folder / "binary").write_bytes(bytes(range(256)) * 1000)
    for name in ("link.csv", "link.mcap"):
        (folder / name).symlink_to("my.toml")
    return folder, contents(folder)


@pytest.fixture
def refused(monkeypatch, capfd):
    """Run the command line in this process; return what it says of the error."""
    numbers = (signal.SIGTERM, signal.SIGHUP)
    usual = [signal.getsignal(number) for number in numbers]

    def refused(*args):
        monkeypatch.setattr(sys, "argv", ["skinbus", *args])
        with pytest.raises(SystemExit) as end:
            main()
        said = " ".join(capfd.readouterr().err.split())
        assert end.value.code == 2, said
        return said

    yield refused
    for number, handler in zip(numbers, usual, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize(
    "row", [*filter(None, REFUSED.splitlines())], ids=lambda row: row.partition(" ->")[0].strip()
)
def test_wrong_words_are_refused_and_no_file_changes(files, refused, monkeypatch, row):
    folder, before = files
    monkeypatch.chdir(folder)
    words, _, parts = row.partition("->")
    said = refused(*words.split())
    assert all(part.strip() in said for part in parts.split("|")), said
    assert contents(folder) == before
    assert os.readlink("link.csv") == "my.toml"
