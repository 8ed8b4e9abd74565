"""What a model refuses."""


class ModelRangeError(ValueError):
    """What is asked for lies outside what the model can answer."""


class ForceOutOfReachError(ModelRangeError):
    """The force is not reached at the deepest indentation that the model answers."""
