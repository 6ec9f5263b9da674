"""The bundle: one weighted least-squares adjustment, with covariance."""
