"""Results of Song & Sharf 2020 beside those of zmp_sqp."""
