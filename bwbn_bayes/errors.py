"""The one exception that means "the user can mend this"."""


class UserError(ValueError):
    """A mistake in a model, a record or an option.

    The message is one sentence: what is wrong, where, and what to do. The command line prints it without a
    traceback and exits with code 2.
    """
