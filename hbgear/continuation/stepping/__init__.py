"""Step-size control: predictor, acceptance of a point, next step."""
