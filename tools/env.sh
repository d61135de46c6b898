# Sourced by the tools: makes .venv with skinbus and the extras asked for, once, and again when pyproject.toml changes.
#   source tools/env.sh everything   what tests, checks and docs need
#   source tools/env.sh runtime      what skinbus needs to run
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
wanted=$1 # given by each tool: without one, bash would pass those of the tool
is_installed() { [ -f ".venv/.$1" ] && [ ! pyproject.toml -nt ".venv/.$1" ]; }
if ! is_installed everything && ! is_installed "$wanted"; then
  python=${PYTHON:-python3}
  "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "skinbus needs Python 3.11 or newer; set PYTHON=/path/to/it" >&2; exit 2; }
  if [ "$wanted" = runtime ]; then
    echo "installing skinbus to .venv (once, 380 MB)" >&2
    project=.
  else
    echo "installing skinbus, its tests and its docs to .venv (once, 1.6 GB, about a minute)" >&2
    project='.[test,docs]'
  fi
  # The pip of the machine installs to .venv: one of its own would take 7 s. Debian's Python may have none.
  if "$python" -m pip --version >/dev/null 2>&1; then
    "$python" -m venv --without-pip .venv
    pip=("$python" -m pip --python .venv/bin/python)
  else
    "$python" -m venv .venv
    pip=(.venv/bin/python -m pip)
  fi
  "${pip[@]}" install --quiet --disable-pip-version-check --no-compile -e "$project"
  touch ".venv/.$wanted"
fi
unset PYTHONDONTWRITEBYTECODE # what is imported is compiled once: the tests start hundreds of processes
export PATH="$PWD/.venv/bin:$PATH"
