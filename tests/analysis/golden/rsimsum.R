# Numbers of rsimsum (github.com/ellessenne/rsimsum, R/performance.R) for estimates.csv, which this project generated.
# Usage: Rscript rsimsum.R PERFORMANCE.R > rsimsum.csv, with that file of the package's source.
source(commandArgs(trailingOnly = TRUE)[1])
d <- read.csv("estimates.csv")
d[[":true"]] <- d$truth
control <- list(na.rm = TRUE, level = 0.95, mcse = TRUE, power_df = NULL)
cat("parameter,method,stat,est,mcse\n")
for (p in unique(d$parameter)) {
  of <- function(m) d[d$parameter == p & d$method == m, ]
  for (m in unique(d$method)) {
    reference <- of("paper")$estimate
    s <- .performance(of(m), "estimate", "standard_error", TRUE, sd(reference, na.rm = TRUE),
                      cor(reference, of(m)$estimate, use = "complete.obs"), NULL, NULL, control)
    cat(sprintf("%s,%s,%s,%.17g,%.17g\n", p, m, s$stat, s$est, s$mcse), sep = "")
  }
}
