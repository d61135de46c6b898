"""Write the law of the usual layer of rubber into EDS: `python -m tools.shipped_law eds/skin-patch*.eds`."""

import sys
from pathlib import Path

from skinbus.study.generic_law import write_generic_law

if __name__ == "__main__":
    for file in map(Path, sys.argv[1:]):
        found = write_generic_law(file)
        print(f"{file}: k(0) {found.table[0]:.0f} 1/m^2, misfit {100 * found.misfit:.1f} %")
