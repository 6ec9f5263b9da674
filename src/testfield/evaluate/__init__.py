"""Cases and what is concluded from them: `case`, `execute` (one executor for all), `check`, `compare` and its page."""
