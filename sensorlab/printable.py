"""Text that other files brought, as it may be shown on a terminal."""


def printable(text):
    """The text with control characters and the like as escapes, in one line."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode()
                   for c in str(text))
