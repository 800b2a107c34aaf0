#!/bin/sh
# Collect everything an installation without internet needs:
#     deploy/wheelhouse.sh FOLDER [EXTRA,...]
# Run it on a connected computer with the same system, processor and Python as the plant's; then
# carry FOLDER and this repository over and run there:  WHEELS=FOLDER deploy/install.sh TARGET
set -eu
folder=${1:?"say where to: deploy/wheelhouse.sh FOLDER [EXTRA,...]"}
extras=${2:-postgres}
here=$(cd "$(dirname "$0")/.." && pwd)
python=${PYTHON:-python3}

mkdir -p "$folder"
set -- --disable-pip-version-check download --quiet --dest "$folder" --only-binary :all: \
    --constraint "$here/constraints.txt"
torch=$(grep '^torch==' "$here/constraints.txt")
if [ -n "${TORCH_INDEX:-}" ]; then
    "$python" -m pip "$@" --index-url "$TORCH_INDEX" "$torch"
    set -- "$@" --find-links "$folder"
fi
"$python" -m pip "$@" setuptools
"$python" -m pip "$@" "$here[$extras]"
# What is in it, for whoever has to know: hashes of every file, and the bill of materials where it was made.
cp "$here/requirements.lock" "$folder"
if [ -f "$here/dist/stemwatch.cdx.json" ]; then cp "$here/dist/stemwatch.cdx.json" "$folder"; fi
echo "$(find "$folder" -name '*.whl' | wc -l) wheels, $(du -sh "$folder" | cut -f1), in $folder"
