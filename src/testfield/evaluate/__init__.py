"""Cases and what is concluded from them: `case`, `execute` (one executor for all), `check` (a figure and its limit)."""
