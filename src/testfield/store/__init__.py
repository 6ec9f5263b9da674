"""Whole files, the ledger of what each was made from, one writer a folder, pools that end with their command."""
