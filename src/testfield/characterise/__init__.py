"""What a sensor is, measured from flat-field pairs and darks as EMVA 1288 release 4.0 (linear model) does."""
