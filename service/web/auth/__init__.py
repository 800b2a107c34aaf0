"""Authentication and authorisation of requests: sessions in cookies, tokens, forms."""
