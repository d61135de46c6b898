# Sourced by the tools: makes .venv with skinbus and its extras for tests and docs, once, and again when pyproject.toml changes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
stamp=.venv/.installed
if [ ! -f "$stamp" ] || [ pyproject.toml -nt "$stamp" ]; then
  python=${PYTHON:-python3}
  "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "skinbus needs Python 3.11 or newer; set PYTHON=/path/to/it" >&2; exit 2; }
  echo "setting up .venv (once, about a minute)" >&2
  "$python" -m venv .venv
  .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-compile -e '.[test,docs]'
  touch "$stamp"
fi
unset PYTHONDONTWRITEBYTECODE # the tests start hundreds of processes, and what is imported is compiled once
export PATH="$PWD/.venv/bin:$PATH"
