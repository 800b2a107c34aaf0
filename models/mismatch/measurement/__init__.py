"""How the numbers of a recording came to be: what sensor, recorder and archive made of them."""
