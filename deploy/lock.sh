#!/bin/sh
# Renew requirements.lock from pyproject.toml: exact versions with hashes, one file for x86_64 and
# aarch64 and for every Python we support, naming no index. Versions already locked are kept
# unless --upgrade is given.
set -eu
cd "$(dirname "$0")/.."
command -v uv >/dev/null 2>&1 || PATH=$PWD/.venv/bin:$PATH
command -v uv >/dev/null 2>&1 || {
    echo "error: uv is needed to renew the lock: .venv/bin/pip install uv" >&2
    exit 1
}
uv pip compile pyproject.toml --group dev --output-file requirements.lock --constraint deploy/lock-constraints.txt \
    --universal --python-version 3.11 --generate-hashes --only-binary :all: \
    --no-emit-index-url --no-emit-find-links --no-header --no-annotate --quiet "$@"
