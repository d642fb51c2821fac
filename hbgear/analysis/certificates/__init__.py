"""Certificates: proofs in ball arithmetic that a motion or a special point exists, is unique and is stable or not."""
