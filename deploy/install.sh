#!/bin/sh
# Install stemwatch into an environment of its own:
#     deploy/install.sh TARGET [EXTRA,...]
# TARGET is the folder of the environment; EXTRA are optional parts (postgres, opcua, cluster).
# Python 3.11 or later is taken from PYTHON (default python3).
# Where a folder WHEELS is named, nothing else is asked and no network is needed; TORCH_INDEX is the
# address of an index with torch for processors alone, for who wants no graphics libraries.
# The image and the notes for systemd use these same steps.
set -eu
target=${1:?"say where to: deploy/install.sh TARGET [EXTRA,...]"}
extras=${2:-postgres}
here=$(cd "$(dirname "$0")/.." && pwd)
python=${PYTHON:-python3}

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "$python is older than Python 3.11; name another: PYTHON=python3.12 $0 $target" >&2
    exit 1
}
"$python" -m venv "$target"
pip() { "$target/bin/python" -m pip --disable-pip-version-check --quiet "$@"; }

set -- install --constraint "$here/constraints.txt" --only-binary :all: --no-cache-dir
if [ -n "${WHEELS:-}" ]; then
    set -- "$@" --no-index --find-links "$WHEELS"
fi
# torch alone and first: it is the largest part, changes least, and may have an index of its own.
torch=$(grep '^torch==' "$here/constraints.txt")
if [ -n "${TORCH_INDEX:-}" ]; then
    pip "$@" --index-url "$TORCH_INDEX" "$torch"
else
    pip "$@" "$torch"
fi
pip "$@" setuptools
# Built without isolation, so that a plant without internet needs no second set of build tools.
pip "$@" --no-build-isolation "$here[$extras]"
"$target/bin/stemwatch" --version
