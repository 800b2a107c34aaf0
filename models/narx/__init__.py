"""NARX networks, ``y(t) = f(y(t-1..t-ny), u(t-1..t-nu))``, trained for the free run."""
