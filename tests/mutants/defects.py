"""The planted defects, room by room. See README.md."""

from planting import Defect

CARD = "tests/test_scorecard_by_hand.py::test_every_figure_of_the_scorecard_is_that_of_the_arithmetic_by_hand"
CONSOLE = "tests/test_scorecard_by_hand.py::test_the_console_shows_the_ten_figures_in_their_order"
REACH = "tests/test_scorecard_by_hand.py::test_what_lies_just_beyond_a_dots_radius_is_another_thing"
CENTRES = "tests/test_scorecard_by_hand.py::test_projected_centres_are_compared_with_projected_centres"
COUNTS = "tests/test_scorecard_by_hand.py::test_the_page_counts_detections_as_they_are"
CAMERA = "tests/test_scorecard_by_hand.py::test_the_page_shows_the_camera_true_and_found"
GRAPH = "tests/test_scorecard_by_hand.py::test_the_page_shows_the_boards_and_their_graph"
BARS = "tests/test_scorecard_by_hand.py::test_the_page_shows_each_bar"
CHECKS = "tests/test_scorecard_by_hand.py::test_the_page_shows_each_check_point_the_worst_first"
ACCEPT = "tests/test_accept_by_hand.py::test_every_figure_of_the_acceptance_is_that_of_the_arithmetic_by_hand"
CLAIMS = "tests/test_accept_by_hand.py::test_claims_of_points_are_judged_point_by_point_and_coordinate_by_coordinate"
NEIGHBOURS = "tests/test_accept_by_hand.py::test_neighbours_on_a_line_share_the_uncertainty_of_two_places"
SADDLE = "tests/test_accept_by_hand.py::test_a_saddle_of_a_twentieth_is_a_form_error_of_a_tenth"
VERDICT = "tests/test_accept_by_hand.py::test_the_verdict_by_hand"
ACCEPT_PAGE = "tests/test_accept_by_hand.py::test_the_page_of_an_acceptance_shows_these_figures"
ACCEPT_SAID = "tests/test_accept_by_hand.py::test_the_console_of_an_acceptance_shows_these_figures"
KEYS = "tests/test_keys.py::test_a_change_of_any_value_changes_the_keys_of_the_stages_that_depend_on_it"
OWN_CODE = "tests/test_keys.py::test_every_stage_reacts_to_its_own_code_and_to_no_other"
DOING = "tests/test_code_digest.py::test_constants_operators_defaults_calls_fields_and_names_count"
OWN_FILE = "tests/test_keys.py::test_every_algorithm_counts_with_its_own_file"
INPUTS = "tests/test_keys.py::test_inputs_that_are_sound_but_different_change_every_key"
BLOCKS = "tests/test_draws.py::test_blocks_of_rays_are_different_draws"
TRIALS = "tests/test_draws.py::test_trials_are_different_draws_of_pixels_and_of_certificates"
FRAMES = "tests/test_draws.py::test_frames_of_stations_and_of_exposures_are_different_draws_and_the_same_again"
NAMES = "tests/test_draws.py::test_generators_differ_by_seed_and_by_name"
STOPS = "tests/test_draws.py::test_the_adaptive_stops_ask_for_one_block_after_the_other"
PATTERN = "tests/test_draws.py::test_the_sensors_pattern_is_one_and_the_same_however_often_it_is_exposed"
FEW = "tests/test_figures_by_hand.py::test_the_figures_of_few_trials_are_those_of_the_arithmetic_by_hand"
MANY = "tests/test_figures_by_hand.py::test_intervals_of_many_trials_cut_off_as_much_below_as_above"
ENDS = "tests/test_figures_by_hand.py::test_both_ends_of_the_interval_must_agree"
LENGTHS = "tests/test_figures_by_hand.py::test_a_measurement_compares_lengths_as_the_hand_does"
SUMS = "tests/test_figures_by_hand.py::test_a_measurement_counts_and_sums_as_the_hand_does"
SCATTER = "tests/test_figures_by_hand.py::test_scatter_bias_and_honesty_of_an_estimator_by_hand"
RECALL = "tests/test_figures_by_hand.py::test_recall_counts_what_is_found_missed_misread_and_false"
SUMMARY = "tests/test_figures_by_hand.py::test_claims_are_summed_over_trials_as_the_hand_does"
FIT = "tests/test_figures_by_hand.py::test_a_motion_of_all_points_is_no_uncertainty_after_the_fit"
TABLES = "tests/test_figures_by_hand.py::test_a_studys_table_shows_its_rows_as_formatted_and_nothing_for_nothing"
PRINTED = "tests/test_code_facts.py::test_the_makers_numbers_belong_to_the_rings_beside_them"
WORDS = "tests/test_code_facts.py::test_words_stand_under_their_published_numbers"
PHOTOGRAPH = "tests/test_code_facts.py::test_the_printed_numbers_are_read_in_the_photograph"
POISSON = "tests/test_sensor.py::test_few_photons_come_as_poisson_counts_and_not_as_normal_ones"
SHEET = "tests/test_sensor.py::test_mean_and_variance_are_those_of_the_data_sheet"
DARK = "tests/test_sensor.py::test_the_sheet_tells_mean_and_variance_of_the_dark_current"
OPENCV = "tests/test_camera.py::test_opencv_projects_to_the_same_pixels"
DISC = "tests/test_camera.py::test_the_image_of_a_disc_matches_the_closed_form_of_methods_6_4"
TOLERANCE = "tests/test_uncertainty.py::test_the_tolerance_is_half_a_unit_of_the_last_digit"
REGIONS = "tests/test_uncertainty.py::test_regions_of_gaussian_trials_are_the_closed_forms"
ONE_POINT = "tests/test_reconstruction.py::test_of_one_point_the_bundle_learns_no_more_than_gls"
FREEDOM = "tests/test_bundle.py::test_degrees_of_freedom_count_every_observation_and_unknown"
UNUSED = "tests/test_measure.py::test_what_was_certified_and_cannot_be_used_is_a_failure"
EITHER_WAY = "tests/test_measure.py::test_a_grids_size_may_be_written_either_way_round"
HALL = "tests/test_certificates.py::test_the_scale_of_a_hall_is_as_uncertain_as_its_bar"
SCATTERED = "tests/test_certificates.py::test_places_that_scatter_are_taken_as_they_scatter"
UNIT = "tests/test_certificates.py::test_a_bar_alone_in_another_unit_is_doubted_by_the_size_of_the_dots"
LITERAL = "tests/test_pictures.py::test_a_name_is_drawn_as_it_is_written"
HIDDEN = "tests/test_bent_boards.py::test_only_what_cannot_stand_before_a_mark_is_passed_over"
LENGTHS_OF_RINGS = "tests/test_what_was_seen.py::test_rings_of_another_length_are_named_though_some_are_read_by_chance"
SOURCES = "tests/test_run.py::test_every_file_a_stage_computes_with_is_in_its_key"
BAR_FAILS = "tests/test_score_edges_by_hand.py::test_a_check_bar_fails_where_its_error_exceeds_its_expanded_uncertainty"
PLACE = "tests/test_score_edges_by_hand.py::test_a_place_is_what_lies_nearest_to_the_middle_of_its_cell"
TWO_POINTS = "tests/test_score_edges_by_hand.py::test_two_check_points_are_compared_without_a_fit"
ONE_OR_NONE = "tests/test_score_edges_by_hand.py::test_one_check_point_has_no_largest_distance_and_none_has_no_figures"
SCALE = "tests/test_score_edges_by_hand.py::test_the_scale_is_compared_to_a_part_in_a_thousand_million"
RIG = "tests/test_several_by_hand.py::test_the_relative_orientation_of_a_rig_is_compared_in_mrad_and_mm"
EACH_CAMERA = "tests/test_several_by_hand.py::test_each_camera_has_its_own_figures_and_the_worst_stands_in_front"
SPAN = "tests/test_arrangement_by_hand.py::test_lines_span_a_volume_that_they_fill_to_nine_tenths"
ON_BOARD = (
    "tests/test_acceptance_edges_by_hand.py::test_a_plane_of_check_targets_on_a_board_has_nothing_of_the_board_itself"
)
SENTENCE = "tests/test_acceptance_edges_by_hand.py::test_the_sentence_is_that_of_its_verdict_with_its_numbers"
BAND = "tests/test_drawings_by_hand.py::test_errors_are_drawn_with_limit_slope_and_band"
LINES_DRAWN = "tests/test_drawings_by_hand.py::test_every_test_length_is_drawn_between_its_targets_the_worst_thickest"
SMALLER = "tests/test_drawings_by_hand.py::test_a_photograph_on_the_page_is_made_smaller_but_never_larger"
WRITTEN = "tests/test_drawings_by_hand.py::test_a_measurement_writes_what_it_measured"

SCORE = [
    Defect(
        "centre error, rms, shows the bias",
        "DetectionScore.card",
        "float(np.sqrt((any_px**2).mean()))",
        "float(np.hypot(*bias))",
        CARD,
    ),
    Defect(
        "the bias is that of the sizes",
        "DetectionScore.card",
        "any_px.mean(axis=0)",
        "np.abs(any_px).mean(axis=0)",
        CARD,
    ),
    Defect(
        "found counts targets nobody expected",
        "DetectionScore.card",
        "int(self.found[self.expected].sum())",
        "int(self.found.sum())",
        CARD,
    ),
    Defect(
        "dirty ones count as found", "DetectionScore.card", "self.found[self.dirty].sum()", "self.dirty.sum()", CARD
    ),
    Defect(
        "the worst centre is the most positive",
        "DetectionScore.card",
        "np.abs(self.error_px).max(initial=0)",
        "self.error_px.max(initial=0)",
        CARD,
    ),
    Defect("NEES of a centre not per coordinate", "DetectionScore.card", "stated.mean() / 2", "stated.mean()", CARD),
    Defect("wrong codes are never counted", "score_detection", "wrong_code.append(row)", "None", CARD),
    Defect("dots named wrongly are never counted", "score_detection", "wrong_dot.append(row)", "None", CARD),
    Defect(
        "8 px exactly is too small",
        "score_detection",
        "(views.visible == 1) & (views.diameter_px >= EXPECTED_PX)",
        "(views.visible == 1) & (views.diameter_px > EXPECTED_PX)",
        CARD,
    ),
    Defect(
        "half-hidden targets are expected",
        "score_detection",
        "(views.visible == 1) & (__x__ >= EXPECTED_PX)",
        "(views.visible > 0) & (__x__ >= EXPECTED_PX)",
        CARD,
    ),
    Defect(
        "a blob at a hidden mark is no false find",
        "score_detection",
        "cKDTree(__p__[seen])",
        "cKDTree(__p__)",
        CARD,
    ),
    Defect(
        "a dot reaches twice as far",
        "score_detection",
        "np.fmax(0.5 * __d__, LEAST_REACH_PX)",
        "np.fmax(1.0 * __d__, LEAST_REACH_PX)",
        REACH,
    ),
    Defect(
        "discs are compared whatever was measured",
        "score_detection",
        "views.disc_px if observations.centre_of_disc else views.centre_px",
        "views.disc_px",
        CENTRES,
    ),
    Defect(
        "why missed: what is far counts", "_why_missed", "__d__ > views.diameter_px[__s__, __m__]", "__d__ > 1e9", CARD
    ),
    Defect(
        "an RMSE ten times too good",
        "PointScore.card",
        "(float(np.sqrt((e**2).mean())) if n else float('nan') for e in (self.fitted_mm, self.error_mm))",
        "(float(np.sqrt((e**2).mean())) / 10 if n else float('nan') for e in (self.fitted_mm, self.error_mm))",
        CARD,
    ),
    Defect(
        "an RMSE over 3n - 6",
        "PointScore.card",
        "(float(np.sqrt((e**2).mean())) if n else float('nan') for e in (self.fitted_mm, self.error_mm))",
        "(float(np.sqrt((e**2).sum() / (e.size - 6))) if n else float('nan') for e in (self.fitted_mm, self.error_mm))",
        CARD,
    ),
    Defect(
        "u is averaged instead of its square",
        "PointScore.card",
        "np.sqrt((self.u_mm**2).mean())",
        "self.u_mm.mean()",
        CARD,
    ),
    Defect(
        "relative accuracy of the largest distance by the diagonal",
        "PointScore.card",
        "_largest_distance(self.true_mm) / rmse",
        "self.diagonal_mm / rmse",
        CARD,
    ),
    Defect(
        "the band of NEES for n instead of 3n",
        "PointScore.card",
        "chi2.ppf(__p__, 3 * n) / (3 * n)",
        "chi2.ppf(__p__, n) / n",
        CARD,
    ),
    Defect(
        "the worst point before the fit",
        "PointScore.card",
        "np.linalg.norm(self.fitted_mm, axis=1)",
        "np.linalg.norm(self.error_mm, axis=1)",
        CARD,
    ),
    Defect(
        "NEES per point",
        "score_points",
        "nees(__e__, covariance)",
        "nees(__e__, covariance) * error.size / len(error)",
        CARD,
    ),
    Defect(
        "the fit costs no freedom",
        "score_points",
        "int((variances > KNOWN * variances[-1]).sum())",
        "error.size",
        CARD,
    ),
    Defect(
        "an RMSE over 3n without a fit's shift",
        "score_points",
        "points.xyz_mm[rows] @ R.T + t - true",
        "points.xyz_mm[rows] @ R.T - true",
        CARD,
    ),
    Defect(
        "E_n of bars without its factor 2",
        "score_lengths",
        "2 * np.hypot(u, bar.u_length_mm)",
        "np.hypot(u, bar.u_length_mm)",
        CARD,
    ),
    Defect(
        "E_n of bars against the truth",
        "score_lengths",
        "(length - bar.length_mm) / __u__",
        "(length - true) / __u__",
        CARD,
    ),
    Defect("the check bar that is longest too long", "score_lengths", "max(check, key=abs)", "max(check)", CARD),
    Defect(
        "control bars test themselves",
        "score_lengths",
        "[bar['error_mm'] for bar in bars if bar['role'] == 'check' and 'error_mm' in bar]",
        "[bar['error_mm'] for bar in bars if 'error_mm' in bar and bar['name'] == 'control bar']",
        CARD,
    ),
    Defect(
        "scale error against the sheets",
        "score_lengths",
        "calibration.scale - world_scale(world)",
        "calibration.scale - 1",
        CARD,
    ),
    Defect("the mean corner for the worst", "score_camera", "float(size.max())", "float(size.mean())", CARD),
    Defect(
        "NEES of the interior not per parameter",
        "score_camera",
        "nees(__e__, covariance)",
        "nees(__e__, covariance) * len(__e__)",
        CARD,
    ),
    Defect(
        "u of the interior is its variance",
        "score_camera",
        "np.sqrt(np.diag(covariance)).tolist()",
        "np.diag(covariance).tolist()",
        CARD,
    ),
    Defect("used for rejected", "score_camera", "len(calibration.rejected)", "calibration.used", CARD),
    Defect(
        "the mean of boards' rms for their rms",
        "score_boards",
        "float(np.sqrt(np.mean(shifts)))",
        "float(np.mean(np.sqrt(shifts)))",
        CARD,
    ),
    Defect("turns in rad called mrad", "score_boards", "1e3 * float(v)", "float(v)", CARD),
    Defect(
        "NEES of boards not per unknown",
        "score_boards",
        "float(np.divide(*np.sum(squares, axis=0)))",
        "float(np.mean(squares, axis=0)[0])",
        CARD,
    ),
    Defect(
        "boards are taken in the sheets' order",
        "true_in_datum",
        "np.array([names.index(name) for name in board_names])",
        "np.arange(len(board_names))",
        CARD,
    ),
    Defect(
        "the rotation stays in the corners' errors",
        "interior_difference",
        "directions(true, uv_px) @ R.T",
        "directions(true, uv_px)",
        CARD,
    ),
    Defect("covariances stay before the fit", "aligned_covariance", "S @ cov_mm2 @ S.T", "cov_mm2", FIT),
    Defect(
        "the console's centre error is the bias",
        "",
        "(__t__, 'detection.centre_rms_px', '{:.4f} px')",
        "(__t__, 'detection.centre_bias_px', '{:.4f} px')",
        CONSOLE,
    ),
    Defect(
        "the console counts dots for codes",
        "",
        "(__t__, 'detection.wrong_code', '{:d}')",
        "(__t__, 'detection.wrong_dot', '{:d}')",
        CONSOLE,
    ),
]
EDGES = [
    Defect("bars that pass have failed", "ten_figures", "abs(__e__) > 1", "abs(__e__) != 1", BAR_FAILS),
    Defect("places lie in the corners of their cells", "_places", "cell % 1 - 0.5", "cell % 1", PLACE),
    Defect("two check points are fitted", "score_points", "len(rows) >= 3", "len(rows) >= 2", TWO_POINTS),
    Defect("no check point has a distance", "_largest_distance", "len(__p__) > 1", "len(__p__) != 1", ONE_OR_NONE),
    Defect("a million less one", "score_lengths", "1e6 * (__a__ - __b__)", "999999.0 * (__a__ - __b__)", SCALE),
    Defect("turns of rigs in rad called mrad", "score_rigs", "1e3 * __n__(error[:3])", "1.0 * __n__(error[:3])", RIG),
    Defect(
        "the best camera stands in front",
        "score_cameras",
        "max(__e__, key=__k__)",
        "min(__e__, key=__k__)",
        EACH_CAMERA,
    ),
    Defect(
        "a camera is shown with the residuals of all",
        "of_camera",
        "calibration.residual_camera == camera",
        "calibration.residual_camera >= 0",
        EACH_CAMERA,
    ),
    Defect("every volume is spanned", "arrangement", "(1 - CORNER) * size", "(1 - CORNER) % size", SPAN),
    Defect(
        "a board's own marks are check targets",
        "planes",
        "marks.code[(marks.role == CHECK) & __p__]",
        "marks.code[(marks.role <= CHECK) & __p__]",
        ON_BOARD,
    ),
    Defect(
        "what passed is said to have failed",
        "sentence",
        "verdict['verdict'] == 'failed'",
        "verdict['verdict'] != 'failed'",
        SENTENCE,
    ),
    Defect(
        "the band of the slope is none",
        "errors_over_length",
        "1e-6 * line[key] * __r__",
        "1e-6 * line[key] + __r__",
        BAND,
    ),
    Defect(
        "the smallest error is the reddest",
        "plan_of_lengths",
        "np.abs(__d__) / __m__",
        "1 - np.abs(__d__) / __m__",
        LINES_DRAWN,
    ),
    Defect(
        "photographs are embedded as large as they are",
        "_picture",
        "PICTURE_WIDTH / __w__",
        "PICTURE_WIDTH * __w__",
        SMALLER,
    ),
    Defect("a measurement's files are empty", "write_measurement", "save(path)", "path.touch()", WRITTEN),
]
REPORT = [
    Defect(
        "the page's centre error is the bias",
        "",
        "{{ card.detection.centre_rms_px|mm }}",
        "{{ card.detection.centre_bias_px|mm }}",
        COUNTS,
    ),
    Defect(
        "the page counts the measured as found",
        "",
        "{{ card.detection.found }}",
        "{{ card.detection.measured }}",
        COUNTS,
    ),
    Defect(
        "the page calls codes dots", "", "{{ card.detection.wrong_dot }}", "{{ card.detection.wrong_code }}", COUNTS
    ),
    Defect("the page shows u for E_n", "", '{{ bar.en|num("%.2f") }}', '{{ bar.u_measured_mm|num("%.2f") }}', BARS),
    Defect("the page certifies the truth", "", "{{ bar.certified_mm|mm }}", "{{ bar.true_mm|mm }}", BARS),
    Defect(
        "the page's RMSE is unfitted",
        "",
        "RMSE {{ card.points.rmse_mm|mm }}",
        "RMSE {{ card.points.worst_mm|mm }}",
        CHECKS,
    ),
    Defect(
        "micrometres ten times too small",
        "_check_rows",
        "1000 * points.error_mm[k]",
        "100 * points.error_mm[k]",
        CHECKS,
    ),
    Defect("the best check point comes first", "_check_rows", "np.argsort(-__x__)", "np.argsort(__x__)", CHECKS),
    Defect("errors of the interior turned round", "_interior_rows", "found - true", "true - found", CAMERA),
    Defect(
        "joints stand under other stations",
        "_graph_rows",
        "seen.get((station, board))",
        "seen.get((calibration.station_names[0], board))",
        GRAPH,
    ),
    Defect("statuses are counted once each", "_status_rows", "int(counts[k])", "1", COUNTS),
    Defect(
        "the acceptance page's E_n is the error",
        "",
        '{{ r.en|num("%+.2f") }}',
        '{{ r.dl_mm|num("%+.2f") }}',
        ACCEPT_PAGE,
    ),
    Defect("the acceptance page's limit is the error", "", "{{ r.limit_mm|mm }}", "{{ r.dl_mm|mm }}", ACCEPT_PAGE),
    Defect("the acceptance page's sigma is the RMSE", "", "{{ p.sigma_mm|mm }}", "{{ p.rmse_mm|mm }}", ACCEPT_PAGE),
    Defect(
        "u of photographs' points is its square",
        "write_measurement",
        "np.sqrt(np.diag(points.cov_xyz_mm2)).reshape(points.xyz_mm.shape)",
        "np.diag(points.cov_xyz_mm2).reshape(points.xyz_mm.shape)",
        SUMS,
    ),
    Defect(
        "uncoded points count as coded", "Measurement.uncoded", "self.points.code < 0", "self.points.code < -9", SUMS
    ),
    Defect(
        "an empty cell for nothing is a zero",
        "as_html",
        "frame.to_html(index=False, border=0, na_rep=__x__, float_format=__f__)",
        "frame.fillna(0).to_html(index=False, border=0, float_format=__f__)",
        TABLES,
    ),
]
ACCEPTANCE = [
    Defect(
        "E_n of lengths without its factor 2",
        "MeasuredLengths.en",
        "self.dl_mm / (2 * self.u_dl_mm)",
        "self.dl_mm / self.u_dl_mm",
        ACCEPT,
    ),
    Defect(
        "certificates of lengths are exact",
        "MeasuredLengths.cov_dl_mm2",
        "self.cov_measured_mm2 + np.diag(self.u_calibrated_mm**2)",
        "self.cov_measured_mm2",
        ACCEPT,
    ),
    Defect(
        "errors are calibrated minus measured",
        "MeasuredLengths.dl_mm",
        "self.measured_mm - self.calibrated_mm",
        "self.calibrated_mm - self.measured_mm",
        ACCEPT,
    ),
    Defect("B is no limit", "Limit.of", "np.minimum(__e__, self.b_mm)", "__e__", ACCEPT),
    Defect("K in parts per thousand", "Limit.of", "1e-6 * self.k_ppm", "1e-3 * self.k_ppm", ACCEPT),
    Defect("twice the limit is within", "judge", "(size > e).sum()", "(size > 2 * e).sum()", VERDICT),
    Defect(
        "the test's uncertainty is added before refuting",
        "judge",
        "(size - U > e).any()",
        "(size + U > e).any()",
        VERDICT,
    ),
    Defect("missing lengths pass", "judge", "'incomplete' if missing else 'passed'", "'passed'", VERDICT),
    Defect(
        "missing lengths are shown",
        "judge",
        "'shown' if __x__ and not missing else 'open'",
        "'shown' if __x__ else 'open'",
        VERDICT,
    ),
    Defect("the worst length is the largest error's", "judge", "np.argmax(size - e)", "np.argmin(size - e)", ACCEPT),
    Defect("rms of errors about their mean", "figures", "np.sqrt((dl**2).mean())", "dl.std()", ACCEPT),
    Defect("scatter about a line over n", "slope", "left @ left / (n - 2) * __g__", "left @ left / n * __g__", ACCEPT),
    Defect(
        "lengths count as independent in the slope",
        "slope",
        "gain[1] @ lengths.cov_dl_mm2 @ gain[1]",
        "gain[1] @ gain[1] * lengths.cov_dl_mm2.mean()",
        ACCEPT,
    ),
    Defect("neighbours have one uncertain place", "spacing", "1 if k == 0 else np.sqrt(2)", "1", NEIGHBOURS),
    Defect(
        "control bars are test lengths",
        "test_lengths",
        "[__e__ for bar in field.scale_bars if bar.role == 'check']",
        "[__e__ for bar in field.scale_bars]",
        ACCEPT,
    ),
    Defect(
        "the error of form is its largest height",
        "form_error",
        "float(np.ptp(__x__))",
        "float(np.abs(__x__).max())",
        SADDLE,
    ),
    Defect("flatness is a standard deviation", "flatness", "np.ptp(__x__)", "np.std(__x__)", SADDLE),
    Defect("ellipsoids of 99 %", "points_card", "chi2.ppf(0.95, len(z))", "chi2.ppf(0.99, len(z))", CLAIMS),
    Defect("claimed sigma of a point", "points_card", "np.trace(__x__) / (3 * n)", "np.trace(__x__) / n", CLAIMS),
    Defect(
        "E_n of coordinates without its factor 2",
        "points_card",
        "score.error_mm[left] / (2 * score.u_mm[left])",
        "score.error_mm[left] / score.u_mm[left]",
        CLAIMS,
    ),
    Defect(
        "the console of accept shows the mean error",
        "_figures",
        "('largest |dl|; mean; rms', __x__)",
        "('largest |dl|; mean; rms', __x__[::-1])",
        ACCEPT_SAID,
    ),
]
CHAIN = [
    Defect(
        "render forgets aperture, focus and vignetting",
        "render_keys",
        "(world.interior, world.psf_sigma_px, world.optics, world.flash)",
        "(world.interior, world.psf_sigma_px, world.flash)",
        f"{KEYS}[base-camera]",
    ),
    Defect(
        "render forgets motion", "render_keys", "(lens, __p__, __m__)", "(lens, __p__)", f"{KEYS}[base-target_motion]"
    ),
    Defect(
        "render forgets the sky",
        "render_keys",
        "(world.lights, world.point_lights, world.ambient_radiance, world.sky)",
        "(world.lights, world.point_lights, world.ambient_radiance)",
        f"{KEYS}[map-room]",
    ),
    Defect(
        "render forgets materials",
        "render_keys",
        "(shapes, lights, materials)",
        "(shapes, lights)",
        f"{KEYS}[base-paint]",
    ),
    Defect(
        "expose forgets the seed",
        "expose_key",
        "digest(__c__, __r__, __s__, seeds, __n__)",
        "digest(__c__, __r__, __s__, __n__)",
        f"{KEYS}[base-seed]",
    ),
    Defect(
        "expose forgets the station",
        "expose_key",
        "digest(__c__, __r__, __s__, __d__, station)",
        "digest(__c__, __r__, __s__, __d__)",
        INPUTS,
    ),
    Defect(
        "detect forgets estimator and smallest diameter",
        "detect_key",
        "digest(__c__, __f__, __s__, recipe.centroid, recipe.smallest_diameter_px)",
        "digest(__c__, __f__, __s__)",
        f"{KEYS}[base-measure]",
    ),
    Defect(
        "calibrate forgets its code",
        "calibrate_key",
        "code_digest(module_of('calibrators', __m__), *__l__)",
        "''",
        OWN_CODE,
    ),
    Defect(
        "calibrate forgets the lens' code",
        "calibrate_key",
        "code_digest(module_of('calibrators', __m__), *__l__)",
        "code_digest(module_of('calibrators', __m__))",
        OWN_CODE,
    ),
    Defect(
        "calibrate forgets what is held",
        "recipe_of",
        "{'hold': asked.hold}",
        "{}",
        f"{KEYS}[base-measure]",
    ),
    Defect(
        "calibrate forgets the sheet",
        "calibrate_key",
        "digest(code, observations, field, __a__)",
        "digest(code, observations, __a__)",
        INPUTS,
    ),
    Defect(
        "reconstruct forgets the calibration",
        "reconstruct_key",
        "digest(__c__, observations, calibration, __f__, method)",
        "digest(__c__, observations, __f__, method)",
        INPUTS,
    ),
    Defect(
        "reconstruct takes one method's code for all",
        "reconstruct_key",
        "module_of('reconstructors', method.name)",
        "'testfield.reconstruct.gls'",
        OWN_FILE,
    ),
    Defect(
        "the scorecard keeps old times",
        "score_key",
        "digest(__c__, __m__, __s__, __w__, times)",
        "digest(__c__, __m__, __s__, __w__)",
        INPUTS,
    ),
    Defect("the sheet's key is its code's", "field_key", "digest(field, __c__)", "digest(__c__)", INPUTS),
    Defect(
        "templates do not count as source",
        "sources",
        "other.suffix not in ('.py', '.md')",
        "other.suffix == '.css'",
        SOURCES,
    ),
    Defect(
        "only a module's own file counts",
        "sources",
        "imports(path)",
        "()",
        SOURCES,
    ),
    Defect("comments count as code", "_look", "what_it_does(source).encode()", "source", OWN_CODE),
    Defect(
        "annotations of what a class declares do not count",
        "_WhatItDoes.visit_AnnAssign",
        "self.in_class",
        "False",
        DOING,
    ),
]
SEEDS = [
    Defect(
        "all re-exposures are the same draw",
        "Trials._again",
        "reexposed(run, __s__)",
        "reexposed(run, run.scene.seed)",
        f"{TRIALS}[exposure]",
    ),
    Defect(
        "all blocks of rays are one draw",
        "Trials.block",
        "range(number * BLOCK, (number + 1) * BLOCK)",
        "range(BLOCK)",
        BLOCKS,
    ),
    Defect(
        "all trials are one draw",
        "Trials._again",
        "seed_of(run.scene.seed, f'uncertainty/{self.depth}/{number}')",
        "seed_of(run.scene.seed, f'uncertainty/{self.depth}')",
        f"{TRIALS}[calibration]",
    ),
    Defect(
        "all stations have the same noise",
        "expose",
        "f'expose/{radiance.station}/{name}'",
        "f'expose/{name}'",
        FRAMES,
    ),
    Defect("names do not count in seeds", "_digest", "f'{seed}/{name}'", "f'{seed}'", NAMES),
    Defect(
        "the fixed pattern changes with the noise",
        "expose",
        "_response(values.shape, sensor, seed)",
        "_response(values.shape, sensor, drawn)",
        PATTERN,
    ),
    Defect(
        "all rows have the same numbers",
        "Plane.uniforms",
        "(0, row, 0, 0)",
        "(0, 0, 0, 0)",
        "tests/test_seeds.py::test_numbers_are_those_of_the_papers_generator",
    ),
    Defect(
        "Gaussian for Poisson noise",
        "expose",
        "poisson_quantile(of_electrons.uniforms(rows, width), mean_e)",
        "np.maximum(np.rint(mean_e + np.sqrt(mean_e) * of_electrons.normals(rows, width)), 0)",
        "tests/test_sensor.py::test_few_electrons_are_poisson_and_no_gaussian",
    ),
    Defect(
        "no dark current",
        "expose",
        "mean_e += sensor.dark_e",
        "mean_e += 0",
        "tests/test_sensor.py::test_dark_current_grows_with_time",
    ),
    Defect("new exposures have the old noise", "expose", "seed if noise_seed is None else noise_seed", "seed", FRAMES),
    Defect("the adaptive stop sees one block again and again", "adaptive", "block(len(parts))", "block(0)", STOPS),
    Defect("regions see one block again and again", "adaptive_regions", "block(len(parts))", "block(0)", STOPS),
]
STATISTICS = [
    Defect(
        "few trials have no last degree of freedom", "of_few", "values.std(axis=0, ddof=1)", "values.std(axis=0)", FEW
    ),
    Defect("few trials that lie close seem certain", "of_few", "np.maximum(u, claimed_u)", "u", FEW),
    Defect(
        "trials that lack a point count",
        "of_trials",
        "of_few(result.of(positions_mm[whole]), __u__)",
        "of_few(result.of(np.nan_to_num(positions_mm)), __u__)",
        FEW,
    ),
    Defect(
        "ends of bars are check points",
        "_statement",
        "not length and int(points.code[k // 3]) not in ends",
        "not length",
        FEW,
    ),
    Defect(
        "intervals cut off below alone",
        "_figures",
        "np.full(values.shape[1], (m - covered) // 2)",
        "np.full(values.shape[1], m - covered - 1)",
        MANY,
    ),
    Defect(
        "scatter between blocks is not their mean's",
        "adaptive",
        "np.std(figures, axis=0, ddof=1) / np.sqrt(len(figures))",
        "np.std(figures, axis=0, ddof=1)",
        MANY,
    ),
    Defect(
        "one end of the interval may disagree",
        "validate",
        "np.maximum(d_low, d_high)",
        "np.minimum(d_low, d_high)",
        ENDS,
    ),
    Defect("the linear interval of one sigma", "validate", "norm.ppf(0.5 + trials.p / 2) * u", "u", ENDS),
    Defect("a tolerance of a whole unit", "tolerance", "0.5 * 10.0**exponent", "10.0**exponent", TOLERANCE),
    Defect("ellipsoids of one component", "coverage_factor", "chi2.ppf(p, components)", "chi2.ppf(p, 1)", REGIONS),
    Defect(
        "bands of NEES of one side", "nees_band", "chi2.ppf(0.5 - p / 2, freedom)", "chi2.ppf(1 - p, freedom)", ACCEPT
    ),
    Defect(
        "E_n of photographs without its factor 2", "lengths_of", "2 * np.hypot(u, __c__)", "np.hypot(u, __c__)", LENGTHS
    ),
]
BENCH = [
    Defect(
        "efficiency upside down", "figures", "float(2 / np.nanmean(sizes))", "float(np.nanmean(sizes) / 2)", SCATTER
    ),
    Defect(
        "scatter of few runs is not corrected",
        "figures",
        "(error - mean) * np.sqrt(count / (count - 1))[:, None]",
        "error - mean",
        SCATTER,
    ),
    Defect("rms leaves out the bias", "figures", "np.sqrt(np.nanmean(error**2))", "np.nanstd(error)", SCATTER),
    Defect(
        "honesty not per coordinate",
        "figures",
        "np.einsum(__f__, e, np.linalg.inv(__c__), e) / 2",
        "np.einsum(__f__, e, np.linalg.inv(__c__), e)",
        SCATTER,
    ),
    Defect(
        "chance counts as bias",
        "systematic",
        "np.sqrt(max(squares / means.size - variance, 0))",
        "np.sqrt(squares / means.size)",
        SCATTER,
    ),
    Defect("what is found anywhere counts", "count", "(asked & hit).sum()", "hit.sum()", RECALL),
    Defect(
        "misread numbers are right", "count", "(asked & (number == view.code)).sum()", "(asked & hit).sum()", RECALL
    ),
    Defect("false finds are not counted", "count", "int((good & ~here).sum())", "0", RECALL),
    Defect(
        "a share of clusters scatters like independent trials",
        "share_of_clusters",
        "variance = clusters / (clusters - 1) * square.sum() / total**2",
        "variance = share * (1 - share) / total",
        "tests/test_statistics.py::test_a_shares_interval_holds_whatever_the_correlation_within_clusters",
    ),
    Defect(
        "the jackknife of n clusters as if of n values",
        "jackknife",
        "np.sqrt((n - 1) / n * __x__)",
        "np.sqrt(1 / (n - 1) / n * __x__)",
        "tests/test_statistics.py::test_the_jackknife_of_a_mean_is_students_interval",
    ),
    Defect(
        "a check that is open passes",
        "Check.outcome",
        "self.limit.holds(low) and self.limit.holds(high)",
        "self.limit.holds(low) or self.limit.holds(high)",
        "tests/test_check.py::test_the_outcome_is_that_of_the_interval",
    ),
    Defect(
        "a covariance that is wrong stays within the band",
        "claim_checks",
        "Limit(1 - (high - nees.value), 1 + (nees.value - low))",
        "Limit(0, 2)",
        "tests/test_claims_over_worlds.py::test_a_covariance_one_fifth_wrong_turns_a_suite_red",
    ),
    Defect(
        "coverage of a sphere of one coordinate", "Errors.covered", "chi2.ppf(P, self.size)", "chi2.ppf(P, 1)", SUMMARY
    ),
    Defect("NEES of claims not per degree of freedom", "Errors.nees", "max(len(self.error), 1)", "1", SUMMARY),
]
PHYSICS = [
    Defect("no read noise", "expose", "electrons += sensor.read_noise_e * __z__", "electrons += 0 * __z__", SHEET),
    Defect(
        "numbers from the end of the table",
        "code_words",
        "words[smallest_rotation(words, bits) == words]",
        "words[smallest_rotation(words, bits) == words][::-1].copy()",
        WORDS,
    ),
    Defect(
        "numbers from zero", "number_of_word", "np.where(__t__, index + 1, 0)", "np.where(__t__, index, 0)", PRINTED
    ),
    Defect(
        "words of odd parity",
        "code_words",
        "np.bitwise_count(words) % 2 == 0",
        "np.bitwise_count(words) % 2 == 1",
        WORDS,
    ),
    Defect(
        "rings are read the wrong way round",
        "_read",
        "2 * word + (level[b] > middle)",
        "word + (level[b] > middle) * 2**b",
        PHOTOGRAPH,
    ),
    Defect(
        "the principal point half a pixel off",
        "Interior.corners_px",
        "self.width_px - 0.5, self.height_px - 0.5",
        "self.width_px - 1.0, self.height_px - 1.0",
        CARD,
    ),
    Defect(
        "pose inverse forgets the rotation",
        "Poses.inverse",
        "-np.einsum('nij,nj->ni', transposed, self.t_mm)",
        "-self.t_mm",
        CARD,
    ),
    Defect(
        "lines weigh without their noise",
        "all_together",
        "np.where(sights.there[..., None, None], own, np.eye(2))",
        "np.where(sights.there[..., None, None], 1e-9 * own, np.eye(2))",
        ONE_POINT,
    ),
]
CERTIFICATES = [
    Defect(
        "a distance that cannot be used is forgotten",
        "_not_used",
        "scale_from not in ('control points', 'distances')",
        "False",
        UNUSED,
    ),
    Defect("a scale by diameters is exact", "by_scale", "scale_from != 'diameters'", "True", UNUSED),
    Defect("checks are compared in an arbitrary scale", "lengths_of", "scale_from == 'nothing'", "False", UNUSED),
    Defect("a grid's columns as written", "_of_grid", "max(target.columns, target.rows)", "target.columns", EITHER_WAY),
    Defect(
        "distances hold the scale by their number",
        "_similarity",
        "network.distances.length_mm / np.maximum(network.distances.u_mm, EXACT_MM)",
        "1e-3 / np.maximum(network.distances.u_mm, EXACT_MM)",
        HALL,
    ),
    Defect("places that scatter stay as certain", "_scattered", "times**2 - 1", "0 * times", SCATTERED),
    Defect("dots may be of any size", "doubtful_scale", "DOTS_MM[0] <= middle <= DOTS_MM[1]", "True", UNIT),
    Defect("a ring read by chance says nothing", "of_rings", "len(ringed) <= read", "read > 0", LENGTHS_OF_RINGS),
    Defect("what hides a mark is half as wide", "_towards", "1.001 * radius_mm", "0.5 * radius_mm", HIDDEN),
    Defect("labels are formulas", "LiteralFigure._take_literally", "text.set_parse_math(False)", "text", LITERAL),
]
RULE = "tests/test_study.py::test_a_rule_asks_for_the_whole_interval"
FEW_WORLDS = "tests/test_study.py::test_too_few_worlds_leave_a_comparison_open"
WORST = "tests/test_study.py::test_a_claim_is_worth_what_its_worst_finding_is"
UNMEASURED = "tests/test_study.py::test_a_paragraph_whose_figures_were_not_measured_is_left_out"
STUDIES = [
    Defect(
        "a study's rule holds on the wrong side",
        "by_side",
        "Outcome.HOLDS if side is holds else __r__",
        "Outcome.HOLDS if side is not holds else __r__",
        RULE,
    ),
    Defect(
        "a study compares however few worlds",
        "less",
        "not quantities[enough[0]].value >= enough[1]",
        "quantities[enough[0]].value < 0",
        FEW_WORLDS,
    ),
    Defect(
        "a study's claim fails only where nothing is open",
        "verdict_of",
        "(Outcome.FAILS, Outcome.OPEN)",
        "(Outcome.OPEN, Outcome.FAILS)",
        WORST,
    ),
    Defect(
        "a study concludes without figures",
        "concluded",
        "by_name[name].measured and __x__",
        "by_name[name] and __x__",
        UNMEASURED,
    ),
]
LATTICE = "tests/test_lattice.py"
SMOOTH = "tests/test_smooth_pixels.py::test_one_ray_where_no_edge_is_loses_nothing[dots and rings]"
ANY_SIZE = "tests/test_smooth_pixels.py::test_an_outline_of_any_size_marks_all_pixels_that_it_passes[40.0]"
SHAKEN = "tests/test_smooth_pixels.py::test_one_ray_where_no_edge_is_loses_nothing[defocus]"
BORDERS = "tests/test_smooth_pixels.py::test_a_panels_border_is_nearly_as_true_as_a_mark"
SHARP = "tests/test_smooth_pixels.py::test_a_sharp_shadow_is_seen_cell_by_cell_and_a_soft_one_is_not"
ONCE = "tests/test_shadows.py::test_what_two_rectangles_hide_counts_once"
WINDOW = "tests/test_shadows.py::test_a_window_in_the_middle_hides_its_own_part"
BEHIND = "tests/test_shadows.py::test_what_lies_behind_the_lamp_or_the_point_hides_nothing"
WHOLE_PATHS = "tests/test_gather.py::test_one_ray_that_knows_the_light_it_meets_says_what_whole_paths_say"
MORE_RAYS = "tests/test_gather.py::test_more_rays_give_the_same_light"
NEAR_EDGE = "tests/test_gather.py::test_light_that_falls_past_something_near_is_followed"
LEFT_NOISE = "tests/test_gather.py::test_noise_of_estimates_is_left_behind_whatever_the_light"
SWINGS = "tests/test_gather.py::test_a_polynomial_comes_back_as_it_is_and_does_not_swing_beyond_the_last_point"
RENDERING = [
    Defect(
        "pixels beside an outline's points are smooth",
        "edge_pixels",
        "cv2.dilate(crossed, around) > 0",
        "crossed > 0",
        SMOOTH,
    ),
    Defect(
        "borders have no finer cells than prints",
        "traced",
        "((EDGE, 1), (BORDER, max(1, round(__x__))))",
        "((EDGE, 1), (BORDER, 1))",
        BORDERS,
    ),
    Defect(
        "outlines are followed at one shot only",
        "_eye",
        "pupil + (camera_mm - pupil) * (optics.focus_mm / camera_mm[:, 2:])",
        "camera_mm",
        SHAKEN,
    ),
    Defect("a sharp shadow is smooth", "_kinked", "kink > 2 * steps", "kink < 0 * steps", SHARP),
    Defect(
        "what an edge's pixel sends aside is left out",
        "_send",
        "image[row[k] - down, column[k] - d] += total",
        "image[row[k] - down, column[k] - d] += 0 * total",
        SMOOTH,
    ),
    Defect(
        "light between rays is straight however it bows",
        "_even",
        "np.maximum(__a__, __b__) <= BOW * __c__",
        "np.maximum(__a__, __b__) < np.inf",
        f"{LATTICE}::test_light_that_bows_more_is_seen_pixel_by_pixel",
    ),
    Defect(
        "light is straight on the brightest lamp's scale",
        "_even",
        "BOW * nodes[1:-1, 1:-1]",
        "BOW * nodes.max()",
        f"{LATTICE}::test_a_lamp_in_view_makes_nothing_else_coarser",
    ),
    Defect(
        "light is carried across an edge between rays",
        "smooth_pixels",
        "_even(nodes) & free",
        "_even(nodes)",
        f"{LATTICE}::test_nothing_is_carried_across_what_an_edge_crosses",
    ),
    Defect("gaps run on to whichever panel comes last", "ask", "dr.minimum(ahead, a)", "a", ONCE),
    Defect(
        "shadows are seen by lines along the lamp",
        "_Shades.part",
        "self._way(mi.Vector3f(*places), *asks)",
        "[0 * places[0] + 1, 0 * places[0]]",
        WINDOW,
    ),
    Defect(
        "what lies behind the lamp hides it",
        "_Shades._hidden",
        "_clipped(-beyond, -beyond_by, low, high)",
        "(low, high)",
        BEHIND,
    ),
    Defect(
        "the last bounce is forgotten",
        "along",
        "albedo * dr.select(seen, lookup.at(panel, hit.uv), 0) / dr.pi",
        "0.9 * albedo * dr.select(seen, lookup.at(panel, hit.uv), 0) / dr.pi",
        WHOLE_PATHS,
    ),
    Defect(
        "directions of many rays lose their digits",
        "gather",
        "mi.Float(path * GOLDEN) * 2**-32",
        "mi.Float(path) * 0.6180339887498949",
        MORE_RAYS,
    ),
    Defect(
        "light swings beyond the last points",
        "_polynomials",
        "min(MOST_DEGREE, __x__)",
        "count - 1",
        SWINGS,
    ),
    Defect(
        "light past the edge of something near is forgotten",
        "_nodes",
        "_waves(rest, degree**2)",
        "0 * _waves(rest, degree**2)",
        NEAR_EDGE,
    ),
    Defect(
        "noise of the light's estimates is kept",
        "_waves",
        "free[tried] ** 2",
        "1.0",
        LEFT_NOISE,
    ),
    Defect(
        "what is not straight is drawn straight",
        "_follow",
        "bow <= BOW_PX",
        "bow <= 50 * BOW_PX",
        ANY_SIZE,
    ),
]
POWER = "tests/test_paired.py::test_a_difference_of_five_in_a_hundred_is_found_as_often_as_theory_says"
CLUSTERED = "tests/test_paired.py::test_intervals_hold_95_of_a_hundred_where_draws_come_in_scenes"
OF_MANY = "tests/test_paired.py::test_of_many_equal_ones_any_is_called_different_in_no_more_than_five_of_a_hundred"
OF_MANY_EQUIVALENT = (
    "tests/test_paired.py::test_of_many_that_just_matter_any_is_called_equivalent_in_no_more_than_five_of_a_hundred"
)
KNOWN = "tests/test_compare.py::test_a_truth_that_errs_or_a_broken_one_that_wins_condemns_the_page"
COUNTED = "tests/test_compare.py::test_failures_are_counted_and_not_dropped"
CLAIMS = "tests/test_ranks_and_claims.py::test_true_claims_lie_in_the_band_and_small_ones_above"
RANKS = "tests/test_ranks_and_claims.py::test_rank_intervals_hold_all_true_places_at_once_in_95_of_a_hundred"
SHARED = "tests/test_ranks_and_claims.py::test_noise_that_levels_share_is_not_averaged_away"
WORST = "tests/test_worst.py::test_the_largest_error_of_each_is_found_with_what_others_found_there"
FACTOR = "tests/test_comparison.py::test_a_wrong_file_is_named_with_its_field_and_value"
COMPARING = [
    Defect(
        "better and worse are exchanged",
        "difference",
        "other_draws - first_draws",
        "first_draws - other_draws",
        POWER,
    ),
    Defect(
        "draws of one scene count as independent",
        "difference",
        "(mean_of_clusters(part) for part in (means[:, 1] - means[:, 0], *means.T))",
        "(mean_of_clusters(np.concatenate([(b - a) for scene in both for a, b in scene])) for _ in range(3))",
        CLUSTERED,
    ),
    Defect(
        "many differences are judged like one",
        "together",
        "holm(np.array([one.chance for one in differences]))",
        "np.array([one.chance for one in differences])",
        OF_MANY,
    ),
    Defect(
        "many equivalences are judged like one",
        "together",
        "holm(np.array([one.chance_equivalent for one in differences]))",
        "np.array([one.chance_equivalent for one in differences])",
        OF_MANY_EQUIVALENT,
    ),
    Defect("a truth that errs is believed", "sane", "truth.abs() < 1e-9", "truth.abs() < 1", KNOWN),
    Defect("a failed case is left out", "_summary", "int(failed(rows).sum())", "0", COUNTED),
    Defect(
        "regions are wider than stated",
        "_row",
        "squares <= chi2.ppf(level, freedom)",
        "squares <= 2 * chi2.ppf(level, freedom)",
        CLAIMS,
    ),
    Defect("a rank is shown as certain", "rank_intervals", "1 + better[name]", "1 + order.index(name)", RANKS),
    Defect("the best case is shown as the worst", "_largest", "int(np.argmax(size))", "int(np.argmin(size))", WORST),
    Defect("a factor that no scene has is let pass", "setups_of", "len(absent) == len(bases)", "False", FACTOR),
    Defect(
        "levels are taken for draws of their own",
        "mean_over_levels",
        "n / (n - 1) * (of_draws**2).sum()",
        "n / (n - 1) * (of_draws**2).sum() / len(mean)",
        SHARED,
    ),
]
STATED = "tests/test_plan.py::test_predicted_uncertainties_are_those_that_the_measurement_states"
FRAME = "tests/test_plan.py::test_another_board_as_datum_gives_what_its_frame_was_predicted_to_give"
LIT = "tests/test_plan.py::test_the_light_of_a_mark_is_what_a_lamp_and_an_open_sky_throw_on_it"
APART = "tests/test_plan.py::test_boards_that_no_image_joins_are_named_with_their_stations"
BEST = "tests/test_plan_design.py::test_the_first_proposed_station_is_the_best_of_all"
CLEAR = "tests/test_plan_design.py::test_candidates_see_boards_and_keep_clear_of_everything"
OFTEN = "tests/test_plan_design.py::test_more_exposures_lower_the_figure_down_to_what_certificates_leave"
PLANNING = [
    Defect(
        "points are weighed as if the camera were known",
        "by_all",
        "own[some] = gain @ np.swapaxes(gain, 1, 2)",
        "own[some] = normal",
        STATED,
    ),
    Defect(
        "a board's turn moves points the wrong way",
        "rms_in_board",
        "follows[:, :, index[:3]] += cross_matrix(offset)",
        "follows[:, :, index[:3]] -= cross_matrix(offset)",
        FRAME,
    ),
    Defect(
        "half of each lamp is dark", "lamp_light", "lamp.radiance * wx * wy / 16", "lamp.radiance * wx * wy / 32", LIT
    ),
    Defect("groups apart are let pass", "_groups", "len(joined) > 1", "len(joined) > 9", APART),
    Defect("the worst candidate is proposed", "_best", "int(np.argmin(scores))", "int(np.argmax(scores))", BEST),
    Defect(
        "candidates stand within things",
        "candidates_of",
        "_looking(job, at[free], look[free])",
        "_looking(job, at, look)",
        CLEAR,
    ),
    Defect("two exposures are worth four", "by_exposures", "n**-0.5", "n**-1.0", OFTEN),
]
CCTAG_NAMED = "tests/test_cctags.py::test_tags_are_named_and_their_centres_measured"
CCTAG_SLANTED = "tests/test_cctags.py::test_the_centre_of_a_slanted_tag_is_not_that_of_its_ellipse"
CCTAG_PRINT = "tests/test_cctags.py::test_the_print_has_every_crown"
CCTAG_TABLES = "tests/test_cctags.py::test_the_tables_are_those_of_cctag"
CCTAG_CLUTTER = "tests/test_cctags.py::test_edges_a_little_beside_those_of_a_tag_are_no_tag"
APRIL_PRINT = "tests/test_april_grid.py::test_the_print_is_kalibrs"
APRIL_NAMED = "tests/test_april_grid.py::test_every_corner_is_named_and_measured_to_a_hundredth_of_a_pixel"
APRIL_CLUTTER = "tests/test_april_grid.py::test_a_board_seen_from_behind_and_clutter_give_no_number"
RUNE_WORDS = "tests/test_rune_tags.py::test_a_number_is_that_of_the_message_and_of_one_turn"
RUNE_PRINT = "tests/test_rune_tags.py::test_what_is_printed_says_the_word"
RUNE_NAMED = "tests/test_rune_tags.py::test_every_dot_is_named_at_any_slant_and_turn"
RUNE_HIDDEN = "tests/test_rune_tags.py::test_a_third_hidden_and_dots_that_are_none_leave_no_dot_wrong"
RUNE_OTHERS = "tests/test_rune_tags.py::test_other_tags_a_tag_from_behind_and_rubbish_have_no_name"
FAMILIES = [
    Defect(
        "words are turned the wrong way about",
        "rune_code",
        "np.arange(SECTORS) + turn[:, None]",
        "np.arange(SECTORS) - turn[:, None]",
        RUNE_WORDS,
    ),
    Defect(
        "the innermost dot is the last bit", "places_of_rune", "np.array([2, 1, 0])", "np.array([0, 1, 2])", RUNE_PRINT
    ),
    Defect("a tag is read clockwise", "_read", "[1, -1]", "[1, 1]", RUNE_NAMED),
    Defect(
        "circles are not seen in perspective",
        "_upright",
        "np.asarray(circle @ _tilted(w))",
        "np.asarray(circle @ _tilted(0 * w))",
        RUNE_NAMED,
    ),
    Defect(
        "hidden sectors count as wrong ones",
        "_expected",
        "(read < 0).sum(axis=1)",
        "9 * (read < 0).sum(axis=1)",
        RUNE_HIDDEN,
    ),
    Defect("any word is the tag's", "_expected", "cost[best] < APART", "cost[best] < 99", RUNE_OTHERS),
    Defect(
        "the outer circle is no edge", "crown_radii", "np.ones(len(inner))", "np.full(len(inner), 1.01)", CCTAG_TABLES
    ),
    Defect(
        "crowns of ink and of paper change places",
        "_discs",
        "np.arange(edges) % 2 == 0",
        "np.arange(edges) % 2 == 1",
        CCTAG_PRINT,
    ),
    Defect(
        "rings are looked for about the centre of their ellipse",
        "_upright",
        "np.asarray(H @ _tilted(w))",
        "np.asarray(H @ _tilted(0 * w))",
        CCTAG_NAMED,
    ),
    Defect(
        "pixels are counted from their corners", "fit_crowns", "theta[3:5].copy()", "theta[3:5] + 0.5", CCTAG_SLANTED
    ),
    Defect(
        "the least likely numbers are tried",
        "_alike",
        "np.argsort(-best.max(axis=0))",
        "np.argsort(best.max(axis=0))",
        CCTAG_SLANTED,
    ),
    Defect(
        "a tag may fit as badly as it likes",
        "_read",
        "best.misfit > (ALONE_MISFIT if alone else WORST_MISFIT)",
        "best.misfit > 9",
        CCTAG_CLUTTER,
    ),
    Defect(
        "the bits of an AprilGrid are read inside out",
        "words_of",
        "tags.generateImageMarker(__k__, side + 2)[1:-1, 1:-1] > 0",
        "tags.generateImageMarker(__k__, side + 2)[1:-1, 1:-1] == 0",
        APRIL_NAMED,
    ),
    Defect("words are turned the wrong way", "words_of", "np.rot90(one, -k)", "np.rot90(one, k)", APRIL_NAMED),
    Defect(
        "any word is a tag's",
        "_by_level",
        "bits <= allowed",
        "bits <= 99",
        APRIL_CLUTTER,
    ),
    Defect("what thinning took is not given back", "_quadrangle", "1.4 * thinned", "-3 * thinned", APRIL_NAMED),
]
DEFECTS = [
    *COMPARING,
    *RENDERING,
    *STUDIES,
    *CERTIFICATES,
    *SCORE,
    *EDGES,
    *REPORT,
    *ACCEPTANCE,
    *CHAIN,
    *SEEDS,
    *STATISTICS,
    *BENCH,
    *PHYSICS,
    *PLANNING,
    *FAMILIES,
]
