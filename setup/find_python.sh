#!/bin/sh
# Print the path of a Python 3.11 or 3.12 that has venv and C headers, or say what is missing.
# If $PYTHON is set, it is the only candidate.
set -u

check='
import os, sys, sysconfig
if sys.version_info[:2] not in ((3, 11), (3, 12)):
    sys.exit("it is Python %d.%d" % sys.version_info[:2])
try:
    import venv, ensurepip
except ImportError:
    sys.exit("it has no venv module (on Ubuntu and Debian: package python3-venv)")
if not os.path.exists(os.path.join(sysconfig.get_paths()["include"], "Python.h")):
    sys.exit("it has no C headers (on Ubuntu and Debian: package python3-dev)")
'
reasons=""
for candidate in ${PYTHON:-python3 python3.12 python3.11}; do
    path=$(command -v "$candidate" 2>/dev/null) || continue
    if reason=$("$path" -c "$check" 2>&1); then
        for tool in gcc g++; do
            command -v "$tool" >/dev/null || { echo "make setup: $tool not found: install it (Ubuntu, Debian: package g++)" >&2; exit 1; }
        done
        "$path" -c 'import sys; print(sys.executable)'
        exit 0
    fi
    reasons="$reasons
  $path: $(echo "$reason" | head -n 1)"
done
echo "make setup: no usable Python 3.11 or 3.12 on PATH: install one, or name it with make PYTHON=/path/to/python3.12$reasons" >&2
exit 1
