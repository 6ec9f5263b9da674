"""Many runs as one table: cases, the one function that does them, and what they say of a claim."""
