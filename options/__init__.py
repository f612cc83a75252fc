"""Options: loaded only when asked for; the product works without them."""
