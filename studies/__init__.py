"""Studies: scripts on the public interface, each with a quick form that the tests run."""
