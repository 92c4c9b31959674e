# Opens the tables of a folder with nanoparquet and arrow, as far as they are installed.
#
#     Rscript open_tables.R DERIVED VALUES
#
# VALUES has of every table what `trilink inspect TABLE --csv` prints, as NAME.csv, and lines of a column
# and its type, as NAME.types. Ends with status 77 if there is nothing to open tables with.

folders <- commandArgs(trailingOnly = TRUE)
readers <- list(
  nanoparquet = function(path) nanoparquet::read_parquet(path),
  arrow = function(path) arrow::read_parquet(path)
)
# What R may make of a type: it has no whole numbers of 64 bits.
classes <- list(
  float64 = "numeric",
  int64 = c("numeric", "integer", "integer64"),
  text = "character",
  boolean = "logical"
)

is_same <- function(found, known, type) {
  same <- switch(type,
    text = as.character(found) == known,
    boolean = found == (known == "true"),
    as.numeric(found) == suppressWarnings(as.numeric(known))
  )
  all(ifelse(is.na(found), known == "", same))
}

check <- function(table, known, types) {
  if (!identical(names(table), types$column)) return("other columns")
  if (nrow(table) != nrow(known)) return(paste(nrow(table), "rows, not", nrow(known)))
  problems <- character()
  for (i in seq_along(types$column)) {
    name <- types$column[i]
    type <- types$type[i]
    class <- class(table[[name]])[1]
    if (!class %in% classes[[type]]) problems <- c(problems, paste(name, "is", class))
    if (!is_same(table[[name]], known[[i]], type)) problems <- c(problems, paste(name, "has other values"))
  }
  problems
}

installed <- names(readers)[vapply(names(readers), requireNamespace, NA, quietly = TRUE)]
problems <- 0
for (library in installed) {
  paths <- list.files(folders[1], pattern = "[.]parquet$", recursive = TRUE)
  for (path in paths) {
    stem <- file.path(folders[2], sub("[.]parquet$", "", path))
    known <- read.csv(paste0(stem, ".csv"), colClasses = "character", na.strings = character(), check.names = FALSE)
    types <- read.table(paste0(stem, ".types"), col.names = c("column", "type"), colClasses = "character")
    for (problem in check(as.data.frame(readers[[library]](file.path(folders[1], path))), known, types)) {
      cat(library, ": ", path, ": ", problem, "\n", sep = "")
      problems <- problems + 1
    }
  }
  cat(library, ": ", length(paths), " tables\n", sep = "")
}
if (length(installed) == 0) quit(status = 77)
quit(status = as.integer(problems > 0))
