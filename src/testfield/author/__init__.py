"""What somebody who plans a job makes: boards to print."""
