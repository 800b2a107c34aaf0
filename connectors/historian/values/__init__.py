"""From value cells to numbers with a quality each: units, status codes, words, codes for "bad"."""
