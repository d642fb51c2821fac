"""What a machine is: matrices, elements with force laws, loads."""
