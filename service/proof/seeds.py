"""Seeds that were looked at while the method was made: a proof must take another one."""

CALIBRATED_WITH = range(4000, 4100)
