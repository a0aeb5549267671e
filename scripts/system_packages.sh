#!/bin/sh
# Sees to what pip cannot install: a C++ compiler, Python's headers and its venv module.
# Usage: system_packages.sh [PYTHON]. As root on Debian or Ubuntu it installs what is missing, else it says so.
set -eu
python=${1:-python3}
missing=""

command -v "$python" >/dev/null || { echo "$python not found: install Python 3.11 or newer" >&2; exit 1; }
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "$python is $("$python" -V 2>&1): facetcam needs Python 3.11 or newer (make PYTHON=...)" >&2; exit 1; }

command -v c++ >/dev/null || command -v g++ >/dev/null || missing="$missing g++"
"$python" -c 'import ensurepip, venv' 2>/dev/null || missing="$missing python3-venv"
"$python" -c 'import os, sys, sysconfig
sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' || missing="$missing python3-dev"

[ -n "$missing" ] || exit 0
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    apt-get update -qq
    # shellcheck disable=SC2086  # one word for each package
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing
else
    echo "missing:$missing; install them first, for example: sudo apt-get install$missing" >&2
    exit 1
fi
