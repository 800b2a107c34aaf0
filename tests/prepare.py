"""What test processes that begin together would each do: ``make test`` does it once, beside the
type checks.

Reading all tests for the first time takes half a minute of a core: Python keeps what it has
compiled of them, and of all that they import. So does compiling the kernels that most tests need,
where the installation has not done it.
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
