"""Search for disconnected branches: starts from backbones and random motions."""
