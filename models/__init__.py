"""The science: recordings, stick-slip fits, NARX networks, health indicators, verdicts. No I/O."""
