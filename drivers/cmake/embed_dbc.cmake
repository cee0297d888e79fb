# cmake -DINPUTS="a.dbc;b.dbc" -DOUTPUT=x.inc -P embed_dbc.cmake: initialisers {"stem", "text"}, for imu/presets.cpp.
set(code "")
foreach(input IN LISTS INPUTS)
  file(READ ${input} text)
  get_filename_component(stem ${input} NAME_WE)
  string(APPEND code "{\"${stem}\", R\"nilio_dbc(${text})nilio_dbc\"},\n")
endforeach()
file(WRITE ${OUTPUT} "${code}")
