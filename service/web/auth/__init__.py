"""Who asks for a page or the API, and whether they may: sessions in cookies, tokens, forms."""
