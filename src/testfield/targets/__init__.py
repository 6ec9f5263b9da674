"""The marks: dots and ring codes as regions of a plane, and the sheets that certify where they are."""
