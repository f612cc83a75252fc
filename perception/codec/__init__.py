"""Wire codecs: points and boxes as compact bytes with a stated error bound."""
