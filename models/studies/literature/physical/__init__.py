"""Force balances of a pneumatic spring-and-diaphragm valve, in SI units."""
