"""What test processes that begin together would each do: ``make test`` does it once, beside the
type checks.

Compiling the kernels that most tests need takes half a minute of a core, and so does reading all
tests for the first time: Python keeps what it has compiled of them, and of all that they import.
"""

from __future__ import annotations

import contextlib
import io

import pytest

from stemwatch.models.compile_kernels import Kernels, compile_kernels

if __name__ == "__main__":
    compile_kernels(list(Kernels))
    # A test that cannot be read is said when the tests are run.
    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main(["--collect-only", "-q", "-p", "no:cacheprovider"])
