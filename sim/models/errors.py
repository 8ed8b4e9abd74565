"""What a model refuses."""


class ModelRangeError(ValueError):
    """What is asked for lies outside what the model can answer."""
